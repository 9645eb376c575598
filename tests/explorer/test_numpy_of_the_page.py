"""What stands in place of numpy in the page without a server does what numpy does."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from phasemap.experiment import arms, prony

PLACE = Path(__file__).parents[2] / "tools" / "browser" / "python" / "numpy" / "__init__.py"
EXPRESSIONS = """
    np.array([[1., 2, 3], [4, 5, 6]])[:, 1]  np.arange(24).reshape(2, 3, 4)[:, [0, 2], 1]
    np.arange(24).reshape(2, 3, 4)[[0, 1], :, [1, 2]]  np.arange(24).reshape(2, 3, 4)[..., 1]
    np.arange(12).reshape(3, 4)[np.arange(12).reshape(3, 4) > 5]
    np.arange(12).reshape(3, 4)[np.array([True, False, True]), 1]
    np.arange(6)[::-1]  np.arange(12).reshape(3, 4).T.reshape(-1)
    np.array([1., 0., -1.]) / np.array([0., 0., 0.])  np.array([1 + 2j, 3]) * 2j
    np.stack([np.arange(3), np.arange(3)], axis=1)  np.concatenate([np.zeros((2, 3)), np.ones((1, 3))])
    np.concatenate([np.zeros((2, 1)), np.ones((2, 3))], axis=1)  np.diff(np.array([1., 4, 9]), prepend=[0.])
    np.diff(np.arange(12).reshape(3, 4) ** 2, axis=0)  np.diff(np.array([True, False]))
    np.unique(np.array([3, 1, 3, 2]), return_index=True)  np.unique(np.array([3, 1, 3, 2]), return_inverse=True)
    np.unique(np.array([3, 1, 3]), return_counts=True)  np.searchsorted(np.array([1., 2, 3]), [2., 2.5], side='right')
    np.where(np.array([True, False]), 1., np.array([2., 3]))  np.tile(np.array([1, 2], np.int8), (3, 1))
    np.repeat(np.arange(6).reshape(2, 3), 2, axis=0)  np.pad(np.ones((2, 2)), [(1, 1), (0, 0)])
    np.take(np.arange(12).reshape(3, 4), [0, 2], 1)  np.delete(np.arange(12).reshape(3, 4), -1, 1)
    np.argwhere(np.array([[0, 1], [1, 0]]))  np.clip(np.array([1., 5, 9]), 2, 6)
    np.arange(6).reshape(2, 3) @ np.arange(3)  np.linspace(0.3, 0.96, 18)
    np.geomspace(0.4, 2.5, 13)  np.maximum(np.array([1., np.nan]), 2)
    np.arange(12).reshape(3, 4).max(axis=0)  np.arange(12).reshape(3, 4).any(0)
    np.array([[1., 2], [3, 4]])[:, None] * np.array([1., 2])  np.round(np.array([1.234, 2.355]), 2)
    np.angle(np.array([1j, 1.]))  np.mean([np.array([1., 2]), np.array([3., 4])], axis=0)
    np.argsort(-np.array([3., 1, 2]))  np.exp(1j * np.array([0.1, 0.2]))
    np.zeros((0, 3)).any()  np.array([]).reshape(-1, 3)
    np.arange(9).reshape(3, 3)[np.ix_([0, 2], [1, 2])]  np.nan_to_num(np.array([1., np.nan]), nan=0.)
    np.isin(np.array([1, 2, 3]), (1, 3))  np.sign(np.array([-2., 0, 3]))
    np.sqrt(np.array([4., -1.]))  np.log(np.array([0., 1.]))
    np.column_stack([np.arange(2), np.arange(2)])  np.broadcast_to(np.array([1., 2]), (2, 2))
    np.diag(np.array([1., 2]))  np.outer(np.array([1., 2]), np.array([3., 4, 5]))
    np.linalg.inv(np.array([[0., 2], [4, 1]]))
"""


@pytest.fixture(scope="module")
def of_page() -> Any:
    spec = importlib.util.spec_from_file_location("numpy_of_the_page", PLACE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def plain(found: Any) -> list[Any]:
    """Results as lists, with their shapes."""
    parts = found if isinstance(found, tuple) else (found,)
    return [(np.shape(one.tolist()), one.tolist()) if hasattr(one, "tolist") else ((), one) for one in parts]


@pytest.mark.parametrize(
    "expression", [one.strip() for one in EXPRESSIONS.replace("  np", "\nnp").splitlines() if one.strip()]
)
def test_an_expression_has_the_value_that_it_has_in_numpy(of_page: Any, expression: str) -> None:
    with np.errstate(all="ignore"):
        found, wanted = (plain(eval(expression, {"np": one})) for one in (of_page, np))
    for (shape, values), (known, others) in zip(found, wanted, strict=True):
        assert shape == known
        np.testing.assert_allclose(np.array(values, complex), np.array(others, complex), rtol=1e-14, equal_nan=True)


def test_a_part_of_an_array_is_a_view_of_it(of_page: Any) -> None:
    for one in (of_page, np):
        whole = one.zeros((3, 4))
        whole[1:][0, 2], whole[:, 1][2] = 5.0, 7.0
        whole[[0, 2], 3] += 1.0
        assert whole.tolist() == [[0, 0, 0, 1], [0, 0, 5, 0], [0, 7, 0, 1]]


def test_a_spectrum_has_the_contact_that_numpy_gives_it(of_page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Eigenvalues and their directions, of rates that are decades apart."""
    key = prony.Prony.preset("PIB").key
    expected = arms.contact_of.__wrapped__(key, 2e-12, 300e3, 2e6)
    tables: list[Any] = []
    monkeypatch.setattr(of_page.ndarray, "ctypes", property(lambda one: tables.append(one) or SimpleNamespace(data=8)))
    for module in (arms, prony):
        monkeypatch.setattr(module, "np", of_page)
    monkeypatch.setattr(arms, "SHORTENED", of_page.geomspace(1.0, 1e6, 400))
    monkeypatch.setattr(arms, "_TABLES", known := dict(arms._TABLES))
    found = arms.contact_of.__wrapped__(key, 2e-12, 300e3, 2e6)
    assert found[:3] == pytest.approx(expected[:3], rel=1e-12)
    n, whole = int(known[expected.address][0]), known[expected.address]
    assert n > 2
    np.testing.assert_allclose(tables[0].tolist(), whole, rtol=1e-9, atol=1e-9 * abs(whole[1 + 3 * n :]).max())
