"""What theory says that a record determines is called so, and nothing else, of plants of other fields."""

import pytest
from benchmarks.known_plants import PLANTS, holds, row_of, table


@pytest.mark.thorough
def test_the_ratios_of_a_free_mass_are_named_and_nothing_more():
    row = row_of("mass, free", 3)
    assert set(row["combinations"]) == {"c/m", "k/m"}
    assert not [n for n, v in row["parameters"].items() if v[0] == "determined"]
    assert all(holds(v[1], v[2], PLANTS["mass, free"].truth[n]) for n, v in row["parameters"].items())
    assert row["followed"]


def test_lags_that_change_places_are_counted_by_their_size():
    row = {"plant": "two lags", "seed": 1, "combinations": {}, "followed": True, "seconds": 1.0, "shot": False}
    rows = {"K": ["determined", 1.4, 1.6], "tau1": ["determined", 11.0, 13.0], "tau2": ["determined", 39.0, 41.0]}
    assert "| two lags | 1 | 1 | 3 of 3 | 3 of 3 | 0 | 3 of 3 | - |" in list(table([row | {"parameters": rows}]))
    swapped = rows | {"tau1": rows["tau2"], "tau2": rows["tau1"]}
    assert "| two lags | 1 | 1 | 3 of 3 | 3 of 3 | 0 | 3 of 3 | - |" in list(table([row | {"parameters": swapped}]))
    wrong = rows | {"K": ["determined", 1.6, 1.7]}
    assert "| two lags | 1 | 1 | 3 of 3 | 2 of 3 | 0 | 2 of 3 | - |" in list(table([row | {"parameters": wrong}]))


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANTS)
def test_theory_and_verdict_agree(name):
    """Two records of each plant; intervals may miss, but none by three times its half width."""
    plant = PLANTS[name]
    for row in (row_of(name, seed) for seed in (31, 32)):
        assert row["followed"]
        for n, (status, low, high) in row["parameters"].items():
            if n in plant.known and n not in plant.alike:
                assert status == "determined"
                aside = 1.5 * (high - low)
                assert holds(low - aside, high + aside, plant.truth[n])
        assert set(plant.combinations) <= set(row["combinations"])
