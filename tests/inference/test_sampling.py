"""Draws from posteriors of which the answer is known."""

import numpy as np
import pytest
from scipy.special import ndtr

from phasemap.inference.sampling import REACH, sample

WORTH = 1000  # independent draws, at least: there are as many walkers


def test_without_data_draws_are_those_of_the_prior():
    found = sample(lambda x: np.zeros(len(x)), 3, 0)
    ends = np.linspace(-1.5, 1.5, 7)
    expected = (ndtr(ends) - ndtr(-REACH)) / (2 * ndtr(REACH) - 1)
    shares = (found.x[..., None] < ends).mean(axis=0)
    np.testing.assert_allclose(shares, np.broadcast_to(expected, shares.shape), atol=4 * 0.5 / np.sqrt(WORTH))


@pytest.mark.parametrize("share", [0.5, 0.2])
def test_two_solutions_far_apart_get_the_share_that_they_deserve(share):
    size, width = 7, 0.1
    centres = np.zeros((2, size))
    centres[:, 0] = -1.2, 1.2  # as likely beforehand; 24 standard deviations of each

    def likelihood(x):
        logs = -0.5 * ((x[:, None] - centres) ** 2).sum(axis=2) / width**2
        return np.logaddexp(np.log(1 - share) + logs[:, 0], np.log(share) + logs[:, 1])

    for seed in range(3):
        right = sample(likelihood, size, seed).x[:, 0] > 0
        # Some 20 steps lead to data as sharp as these; at each, 1,000 walkers are chosen anew by weights whose variance
        # is 1 / 0.6 - 1, so that the share is known within 0.5 sqrt(20 * 0.67 / 1000).
        assert right.mean() == pytest.approx(share, abs=3 * 0.058)


def test_draws_depend_on_the_seed_only():
    one, again, other = (sample(lambda x: -(x**2).sum(axis=1), 2, seed).x for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert (one != other).any()


def test_an_impossible_problem_has_no_draws():
    assert sample(lambda x: np.full(len(x), -np.inf), 2, 0) is None
