"""Solutions by BDF that leave another one where their numbers begin to matter: the bits of scipy's `solve_ivp`, with
fewer steps."""

import numpy as np
import pytest
from scipy.integrate import BDF, solve_ivp

from plantfit.cases.steam.adaptive_bdf import Cost, Solver, Step, descents
from plantfit.cases.steam.bdf_course import Course, Rate

T = np.arange(1, 301) * 0.1
DEAD = 0.43
OPENING = 40.0


def row(seed: int = 5) -> np.ndarray:
    """Tables that are not smooth, so that the solver rejects steps; the pressure reaches about 13 bar and 20 never."""
    rng = np.random.default_rng(seed)
    return np.concatenate([0.3 + 0.1 * rng.random(10), 4 + 2 * rng.random(10), 3 + 2 * rng.random(10), [DEAD]])


def scipy_s_own(numbers: np.ndarray, begin: float = 0.0) -> np.ndarray:
    on = begin < T
    found = solve_ivp(Rate(numbers, OPENING), (begin, T[-1]), [0.0, 0.0], "BDF", t_eval=T[on])
    pressures = np.zeros(len(T))
    pressures[on] = found.y[0] if found.success else np.nan
    return pressures


@pytest.mark.parametrize("at_the_edge", [False, True])
def test_every_moved_number_has_the_bits_of_a_solution_from_the_beginning(at_the_edge):
    own = row()
    course = Course(own, OPENING, T, 1e-3, 1e-6, at_the_edge)
    np.testing.assert_array_equal(course.pressures, scipy_s_own(own, DEAD if at_the_edge else 0.0))
    assert 10 < course.pressures[-1] < 15
    kept = course.pressures.copy()
    for size in (1e-8, 0.3):
        for j in range(31):
            moved = own.copy()
            moved[j] += size
            np.testing.assert_array_equal(
                course.moved(moved), scipy_s_own(moved, moved[30] if at_the_edge else 0.0), err_msg=str(j)
            )
    np.testing.assert_array_equal(course.pressures, kept)


def test_a_dead_time_matters_only_where_the_solver_looks_between():
    own = row()
    course = Course(own, OPENING, T, 1e-3, 1e-6)
    moved = own.copy()
    moved[30] = np.nextafter(DEAD, 1.0)
    assert course.moved(moved) is course.pressures
    moved[30] = DEAD + 0.2
    assert not np.array_equal(course.moved(moved), course.pressures)


def steps_taken(monkeypatch, work) -> int:
    taken, step = [], BDF.step
    monkeypatch.setattr(BDF, "step", lambda self: taken.append(0) or step(self))
    work()
    monkeypatch.undo()
    return len(taken)


def test_a_number_costs_the_steps_from_where_it_is_read(monkeypatch):
    own = row()
    course = Course(own, OPENING, T, 1e-3, 1e-6)
    whole = steps_taken(monkeypatch, lambda: Course(own, OPENING, T, 1e-3, 1e-6))
    by_node = []
    for j in range(10):
        moved = own.copy()
        moved[j] += 1e-8
        by_node.append(steps_taken(monkeypatch, lambda moved=moved: course.moved(moved)))
    assert by_node[0] == pytest.approx(whole, abs=3)
    assert 0 < by_node[5] < 0.5 * whole
    assert by_node[9] == 0  # 20 bar are never reached


def test_a_solver_that_gives_up_is_nan_from_the_beginning_and_from_where_it_left():
    bad = row()
    bad[23] = -bad[23]  # a lag below zero from the third node on: the pressure explodes
    with np.errstate(all="ignore"):
        expected = scipy_s_own(bad)
        assert np.isnan(expected).all()
        assert np.isnan(Course(bad, OPENING, T, 1e-3, 1e-6).pressures).all()
        assert np.isnan(Course(row(), OPENING, T, 1e-3, 1e-6).moved(bad)).all()


def test_differences_at_the_start_are_made_once(monkeypatch):
    step, lower, upper = Step(OPENING, T, scipy_s_own(row()) + 0.01), row() - 0.2, row() + 0.2
    start, whole = np.full(31, 0.5), []
    monkeypatch.setattr(Cost, "_row", lambda self, z, i: whole.append(0) or self.lower + (self.upper - self.lower) * z)
    found = descents([step], lower, upper, start, 40, 0)
    monkeypatch.undo()
    assert found.together.evaluations == 33  # a cost and its gradient, then one cost that leaves no room for a gradient
    assert len(whole) == (1 + 31) + 1 + 1
    np.testing.assert_array_equal(found.slopes, Cost([step], lower, upper, Solver(), 100).differences(start))
