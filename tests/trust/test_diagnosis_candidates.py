"""The table of additions: complete, at the place of the model's extension, with laws whose derivatives are those of
differences."""

import numpy as np
import pytest

from plantfit.models.extensions import KINDS
from plantfit.testing import check_candidate
from plantfit.trust.diagnosis.candidates import CANDIDATES, Before, Behind, Changing, Inside, candidates
from plantfit.trust.diagnosis.catalogue import Extension
from plantfit.trust.diagnosis.plant.timeless.static import CANDIDATES as STATIC

PLACES = {"inputs": Before, "states": Inside, "changes": Changing, "outputs": Behind}


def test_every_extension_of_a_model_is_a_candidate_at_its_place():
    # a curve in time is tried by itself, a part of a static model in a table of its own
    assert set(CANDIDATES) == {name for name, kind in KINDS.items() if not kind.over and name not in STATIC}
    assert set(STATIC) == {name for name, kind in KINDS.items() if kind.to in ("parts", "products")}
    for kind, candidate in CANDIDATES.items():
        assert isinstance(candidate, PLACES[KINDS[kind].to]), kind


def test_a_kind_without_a_row_is_refused():
    unknown = Extension("sensor_gain", "y", "gain of y", "a", None, 0.5, 2.0, (1.1,))
    for of in (lambda: unknown.place, lambda: unknown.linear, lambda: unknown.candidate):
        with pytest.raises(KeyError, match="sensor_gain"):
            of()


@pytest.mark.parametrize("kind", candidates(Behind))
def test_laws_of_sensors_have_the_derivatives_of_differences(kind):
    """By the parameters of the plant (y + a e along a known direction) and by the value, in units scaled by 2.5."""
    draw, scale, value, step = np.random.default_rng(4), 2.5, 0.7, 1e-6
    t = np.sort(draw.uniform(0.0, 3.0, 80))
    y, direction = draw.normal(size=80), draw.normal(size=80)
    candidate = candidates(Behind)[kind]

    def shown(a, v):
        return candidate.law(t, y + a * direction, direction[:, None], v, scale)

    _, slopes, by_value = shown(0.0, value)
    np.testing.assert_allclose(slopes[:, 0], (shown(step, value)[0] - shown(-step, value)[0]) / (2 * step), atol=1e-6)
    assert (by_value is None) == candidate.differenced
    if by_value is not None:
        np.testing.assert_allclose(
            by_value, (shown(0.0, value + step)[0] - shown(0.0, value - step)[0]) / (2 * step), atol=1e-6
        )


@pytest.mark.parametrize("kind", CANDIDATES)
@pytest.mark.thorough
def test_every_candidate_passes_the_exam_for_packages(kind):
    check_candidate(kind, CANDIDATES[kind], KINDS[kind])


def test_laws_of_sensors_are_their_closed_forms():
    t, y, none = np.array([0.0, 1.0, 2.0]), np.array([-1.0, 0.5, 3.0]), np.zeros((3, 0))
    shown = {kind: c.law(t, y, none, 2.0, 4.0)[0] for kind, c in candidates(Behind).items()}  # y is divided by 4
    np.testing.assert_allclose(shown["offset"], [-0.5, 1.0, 3.5])
    np.testing.assert_allclose(shown["drift"], [-1.0, 1.0, 4.0])
    np.testing.assert_allclose(shown["sensor_high"], [-1.0, 0.5, 0.5])
    np.testing.assert_allclose(shown["sensor_low"], [0.5, 0.5, 3.0])
    held = np.array([1.0, -3.0, 0.2])
    before = {kind: c.law(t, held, 0.5, True) for kind, c in candidates(Before).items()}
    np.testing.assert_allclose(before["saturation"], [0.5, -0.5, 0.2])
    np.testing.assert_allclose(before["dead_zone"], [0.5, -2.5, 0.0])
    np.testing.assert_allclose(before["input_offset"], [0.5, -3.5, -0.3])  # shows 0.5 more than the plant gets


def test_bounds_of_the_study_file_hold_the_value_that_was_found():
    for kind, candidate in CANDIDATES.items():
        low, high = candidate.bounds(0.1, 3.0, 0.8)
        assert low < 0.8 < high, kind
        assert (low < 0) == (kind in ("offset", "input_offset", "drift", "start", "change")), kind


@pytest.mark.parametrize("kind", candidates(Behind))
def test_laws_of_sensors_pass_on_what_a_plant_that_explodes_gives(kind):
    """The fit then sees a cost that is not finite, and turns away; before the explosion all is as it was."""
    t, y = np.arange(50.0), np.sin(np.arange(50.0))
    slopes = np.column_stack([y, 2.0 * y])
    bad, bad_slopes = y.copy(), slopes.copy()
    bad[30:], bad_slopes[31:, 1] = np.inf, np.nan
    law = candidates(Behind)[kind].law
    with np.errstate(all="ignore"):
        shown, well = law(t, bad, bad_slopes, 0.7, 1.0), law(t, y, slopes, 0.7, 1.0)
    assert shown[0][:30] == pytest.approx(well[0][:30])
    assert shown[1][:30] == pytest.approx(well[1][:30])
