"""Functions whose kernels are chosen by the kind of their first argument."""

from __future__ import annotations

from typing import Any, NamedTuple

import pytest

from phasemap._kernels.chosen import Chosen
from phasemap._kernels.compilation import kernel


class Square(NamedTuple):
    side: float


class Rectangle(NamedTuple):
    width: float
    height: float


@Chosen
def area_of(shape: Any, share: float) -> float:
    """Share of an area."""
    raise NotImplementedError


@area_of.of(Square)
@kernel
def square_area(shape: Square, share: float) -> float:
    return share * shape.side * shape.side


@area_of.of(Rectangle)
@kernel
def rectangle_area(shape: Rectangle, share: float) -> float:
    return share * shape.width * shape.height


@kernel
def twice(shape: Any) -> float:
    return area_of(shape, 2.0)


@pytest.mark.parametrize(("shape", "area"), [(Square(3.0), 18.0), (Rectangle(2.0, 5.0), 20.0)])
def test_a_kernel_calls_the_one_for_the_kind_it_is_given_and_so_does_python(shape: Any, area: float) -> None:
    assert twice(shape) == area == twice.py_func(shape)


def test_a_kind_that_has_none_is_refused() -> None:
    with pytest.raises(KeyError):
        area_of((1.0,), 2.0)
