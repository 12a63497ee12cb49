import numpy as np
import pytest

from plantfit.study import basins

COSTS = np.array([2.0, 1.0, 1.0 + 1e-9, 5.0, np.inf, 2.0 * (1 - 1e-9), np.nan, 1.0])
X = np.arange(16.0).reshape(8, 2)


def test_runs_of_one_cost_are_one_basin():
    found = basins(COSTS, X)
    assert [b.members for b in found] == [(1, 7, 2), (5, 0), (3,)]
    assert [b.share for b in found] == [3 / 8, 2 / 8, 1 / 8]
    assert found[0].x.tolist() == [2.0, 3.0]
    assert found[0].spread.tolist() == [12.0, 12.0]
    assert found[2].spread.tolist() == [0.0, 0.0]


@pytest.mark.parametrize("scale", [1e-12, 1e9])
def test_scale_does_not_matter(scale):
    assert [b.members for b in basins(scale * COSTS, X)] == [b.members for b in basins(COSTS, X)]


def test_permutation_renames_members_only():
    order = np.array([3, 7, 0, 1, 6, 2, 5, 4])
    found = basins(COSTS[order], X[order])
    assert [{int(order[k]) for k in b.members} for b in found] == [{1, 2, 7}, {0, 5}, {3}]


def test_floor_joins_perfect_fits_and_tolerance_joins_near_ones():
    costs = [1e-28, 3e-25, 1.0]
    assert len(basins(costs, np.zeros((3, 1)))) == 3
    assert len(basins(costs, np.zeros((3, 1)), floor=1e-20)) == 2
    assert len(basins([1.0, 1.05, 1.2], np.zeros((3, 1)), tolerance=0.1)) == 2


def test_no_finite_cost_no_basin():
    assert basins([np.inf, np.nan], np.zeros((2, 1))) == []
