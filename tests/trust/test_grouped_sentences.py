"""Many parameters of one kind share a sentence; a range over powers of ten is not "roughly known"."""

import pytest

from plantfit.trust.verdict.parameters import parameter_sentences


def row(name, status, low, high, value=1.0, error=0.3, ends=None, least=0.0):
    return {"name": name, "status": status, "index": [], "unit": "V", "value": value, "standard_error": error,
            "low": low, "high": high,
            "lower_bound": 0.01, "upper_bound": 100.0, "limits": [least, None], "open": ends}  # fmt: skip


def said(rows, **determined):
    return [s["sentence"] for s in parameter_sentences({"parameters": rows, "determined": determined or None})]


@pytest.mark.parametrize(("low", "high", "words"), [
    (0.4, 2.0, "a is only roughly known: a = 1.00 ± 0.30 V, 0.4 to 2 V."),
    (1e-4, 266.0, "a is hardly known: the data allow 0.0001 to 266 V."),
    (0.0, 2.0, "a cannot be told from zero: the data allow 0 to 2 V."),
])  # fmt: skip
def test_how_little_is_known_is_told_by_the_range(low, high, words):
    assert said([row("a", "weak", low, high)]) == [words]


@pytest.mark.parametrize(("low", "high", "figures"), [
    (0.4, 2.0, {"value": 1.0, "standard_error": 0.3}),
    (0.0, 2.0, {"value": 1.0, "low": 0.0, "high": 2.0}),  # by the standard error at the answer it would be known
])  # fmt: skip
def test_figures_are_those_that_the_sentence_tells(low, high, figures):
    [one] = parameter_sentences({"parameters": [row("a", "weak", low, high)], "determined": None})
    assert one["figures"] == figures


@pytest.mark.parametrize("count", [3, 4])
def test_many_that_are_roughly_known_share_a_sentence(count):
    found = said([row(f"p{k}", "weak", 0.4, 2.0 + k) for k in range(count)])
    if count == 3:
        assert len(found) == 3
    else:
        (one,) = found
        assert one.startswith("4 parameters are only roughly known: p0 = 1.00 ± 0.30 V, 0.4 to 2 V; p1 = ")


def test_kinds_of_weak_are_told_apart():
    rows = [
        row("a", "weak", 0.4, 2.0),
        row("b", "weak", 0.0, 2.0),
        row("c", "weak", 0.0, 3.0),
        row("d", "weak", 0.5, 2.0),
    ]
    assert said(rows) == [
        "2 parameters cannot be told from zero: b 0 to 2 V; c 0 to 3 V.",
        "2 parameters are only roughly known: a = 1.00 ± 0.30 V, 0.4 to 2 V; d = 1.00 ± 0.30 V, 0.5 to 2 V.",
    ]


def test_many_that_are_open_share_a_sentence_and_its_condition():
    rows = [row(n, "flat", 0.0, 100.0, ends="upper") for n in ("m", "k", "c", "b")]
    need = {"known": "m", "at": 2.0, "unit": "kg", "value": 1.0, "standard_error": 0.1}
    (one,) = said(rows, combinations=[], only_if={"k": need, "c": need}, sound=True)
    assert one == (
        "4 parameters are not determined, m, k, c and b: of each the data allow any value above 0. k is determined "
        "only if m is known: "
        "with m = 2 kg, k = 1.00 ± 0.10 V. The same holds for 1 more."
    )


@pytest.mark.parametrize(
    ("product", "low", "high", "words"),
    [
        (True, 0.0196, 0.0199, "a is hardly known: the data allow 0 to 2 V. It is not zero, as R*a is not."),
        (True, -0.1, 0.2, "a cannot be told from zero: the data allow 0 to 2 V."),
        (False, 0.0196, 0.0199, "a cannot be told from zero: the data allow 0 to 2 V."),
    ],
)
def test_what_is_part_of_a_known_product_is_not_zero(product, low, high, words):
    own = {"formula": "R*a" if product else "R + a", "weights": {"R": 1.0, "a": 1.0}, "product": product,
           "value": 0.0198, "low": low, "high": high, "standard_error": 7e-5}  # fmt: skip
    found = said([row("a", "weak", 0.0, 2.0)], combinations=[own], count=1, of=2, only_if={}, sound=True)
    assert found[-1] == words


@pytest.mark.parametrize(
    ("high", "told"), [(2.1, "a*b = 2.000 ± 0.050 (in"), (3.0, "a*b = 2.000 ± 0.050 (1.9 to 3) (in")]
)
def test_a_combination_has_its_interval_where_its_parts_move_it_far(high, told):
    own = {
        "formula": "a*b",
        "weights": {"a": 1.0, "b": 1.0},
        "product": True,
        "value": 2.0,
        "standard_error": 0.05,
        "low": 1.9,
        "high": high,
    }
    found = said([row("a", "flat", None, None, ends="both")], combinations=[own], count=1, of=2, only_if={}, sound=True)
    assert any(told in sentence for sentence in found)
