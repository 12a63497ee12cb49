"""`plantfit tune` says which part runs and which search of how many, and calls a time left that of the search."""

from dataclasses import dataclass, replace

import pytest

from plantfit.cases.shared import stages
from plantfit.cli.terminal import out
from plantfit.control.tune.searching.parts import Searches, begins, within
from plantfit.optimize.loop.progress import estimate


class Clock:
    """A clock of the tests' own."""

    now = 1000.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch):
    found = Clock()
    monkeypatch.setattr(out, "time", found)
    return found


def test_lines_of_a_log_tell_parts_at_once_and_searches_apart(clock, capsys):
    with out.progress_line() as tell:
        begins(tell, "drawing plants")
        searches = Searches(tell, 2)
        clock.now += 70
        first = searches.next("PID, best fit alone")
        assert first is not None
        clock.now += 29
        first(estimate(0, 1, 8, 0, 200, 205.3, 0.3))  # 30 s after the last line come the figures
        clock.now += 6
        first(estimate(0, 1, 8, 0, 200, 205.3, 0.3))
        clock.now += 50
        second = searches.next("PID, all plants")
        assert second is not None
        clock.now += 30
        second(estimate(0, 1, 8, 0, 100, 99.97, 2.5))
    assert capsys.readouterr().err.splitlines() == [
        "0 s: drawing plants",
        "70 s: search 1 of 2 (PID, best fit alone)",
        "105 s: search 1 of 2 (PID, best fit alone): 8 of 200 "
        "evaluations, best cost 205.3, about 7 s left in this search",
        "155 s: search 2 of 2 (PID, all plants)",
        "185 s: search 2 of 2 (PID, all plants): 8 of 100 evaluations, best cost 99.97, about 29 s left in this search",
    ]


def test_a_level_of_a_schedule_is_named_before_its_searches():
    told = []
    inner = Searches(within(told.append, "level 2 of 3"), 2).next("PID, all plants")
    assert inner is not None
    inner(estimate(0, 1, 50, 0, 100, float("inf"), 10.0))
    assert [p.part for p in told] == ["level 2 of 3, search 1 of 2 (PID, all plants)"] * 2
    assert (told[0].begins, told[0].seconds_left) == (True, None)
    assert (told[1].begins, told[1].evaluations, told[1].seconds_left) == (False, 50, pytest.approx(10.0))
    assert out._describe(told[1])[1] == "50 of 100 evaluations, no result yet, about 10 s left in this search"


def test_a_demo_tells_the_searches_of_its_controller_apart():
    told = []
    within_part = stages.within("controller", told.append)
    assert within_part is not None
    begins(within_part, "drawing plants")
    search = Searches(within_part, 2).next("PID, all plants")
    assert search is not None
    search(estimate(0, 1, 50, 0, 100, 2.0, 10.0))
    within_part(estimate(0, 1, 50, 0, 100, 2.0, 10.0))
    assert [out._describe(p) for p in told] == [
        ("controller, drawing plants", ""),
        ("controller, search 1 of 2 (PID, all plants)", ""),
        (
            "controller, search 1 of 2 (PID, all plants)",
            "50 of 100 evaluations, best cost 2, about 10 s left in this search",
        ),
        ("controller", "run 1/1, 50 evaluations, best cost 2, about 10 s left in this search"),
    ]


def test_nothing_is_told_where_nobody_listens():
    begins(None, "drawing plants")
    assert Searches(None, 1).next("PID, all plants") is None
    assert within(None, "level 1 of 2") is None


@dataclass(frozen=True)
class Searched:
    """What a search of studies tells."""

    method: str = "cmaes"
    runs_done: int = 0
    runs: int = 1
    evaluations: float = 8.0
    best: float = 2.0
    seconds_left: float | None = 7.0


def test_a_command_that_is_one_search_keeps_its_words():
    assert out._describe(Searched()) == ("cmaes", "run 1/1, 8 evaluations, best cost 2, about 7 s left in this search")
    assert out._describe(replace(Searched(), seconds_left=None))[1] == "run 1/1, 8 evaluations, best cost 2"
