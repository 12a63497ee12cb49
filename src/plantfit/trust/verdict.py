"""The verdict: plain sentences, each with its number, from the findings record."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.optimize.contract import RunResult
from plantfit.trust.residual_tests import white_part

Sentence = dict[str, Any]


def sentences(findings: Mapping[str, Any], best: RunResult) -> list[Sentence]:
    """The verdict in the order in which a reader needs it."""
    return [
        *_fit(findings),
        *_unseen(findings),
        *_agreement(findings, best),
        *_parameters(findings),
        *_combinations(findings),
        *_residuals(findings),
        *_noise(findings),
        *_steps(findings),
        *_failures(findings),
    ]


def _say(level: str, sentence: str, **figures: float) -> Sentence:
    return {"level": level, "sentence": sentence, "figures": {k: float(v) for k, v in figures.items()}}


def _number(value: float) -> str:
    return f"{value:.3g}"


def _with_unit(value: float, unit: str | None) -> str:
    return f"{_number(value)} {unit}" if unit and unit not in ("1", "") else _number(value)


def _where(findings, row) -> str:
    several = len(findings["recordings"]) > 1
    return f"{row['output']} of {row['recording']}" if several else row["output"]


def _fit(findings):
    for row in findings["scores"]:
        if row["part"] != "fit":
            continue
        percent = row["fit_percent"]
        level = "info" if percent is None else "good" if percent >= 80 else "warning" if percent >= 50 else "bad"
        text = f"The model follows {_where(findings, row)} with an RMSE of {_with_unit(row['rmse'], row['unit'])} on the fitted samples"
        text += f", a fit of {percent:.1f} %." if percent is not None else "."
        yield _say(level, text, rmse=row["rmse"], fit_percent=percent if percent is not None else float("nan"))


def _unseen(findings):
    fitted = {(r["recording"], r["output"]): r["rmse"] for r in findings["scores"] if r["part"] == "fit"}
    unseen = [r for r in findings["scores"] if r["part"] == "validation"]
    if not unseen:
        yield _say(
            "warning", "Nothing was kept unseen, so nothing shows yet that the model holds on new data: give a split or a second recording."
        )
    for row in unseen:
        own = fitted.get((row["recording"], row["output"]))
        base = own if own is not None else min((v for (_, o), v in fitted.items() if o == row["output"]), default=None)
        text = f"On samples it has not seen, the RMSE of {_where(findings, row)} is {_with_unit(row['rmse'], row['unit'])}"
        if base is None or base == 0:
            yield _say("info", text + ".", rmse=row["rmse"])
            continue
        ratio = row["rmse"] / base
        level = "good" if ratio < 1.3 else "warning" if ratio < 2 else "bad"
        end = {"good": "it holds", "warning": "it holds in part", "bad": "it does not hold there"}[level]
        yield _say(level, f"{text}, {ratio:.2f} times that of the fitted samples: {end}.{_shift(row)}", rmse=row["rmse"], ratio=ratio)


def _shift(row) -> str:
    """A constant error that makes up much of the unseen error: drift rather than dynamics."""
    if abs(row["bias"]) < 0.4 * row["rmse"]:
        return ""
    rest = max(row["rmse"] ** 2 - row["bias"] ** 2, 0.0) ** 0.5
    shift = _with_unit(abs(row["bias"]), row["unit"])
    return (
        f" A constant shift of {shift} is part of it (a drift, or an offset that changed); "
        f"without it {_with_unit(rest, row['unit'])} remain."
    )


def _agreement(findings, best):
    extra = best.extra
    if "basin_hits" in extra and "starts" in extra:
        hits, starts = int(extra["basin_hits"]), int(extra["starts"])
        level = "good" if hits >= 3 else "warning"
        text = f"{hits} of {starts} local searches from different starts ended in the best optimum"
        text += "." if hits >= 3 else ": a better one may exist; give a larger budget."
        yield _say(level, text, hits=hits, starts=starts)
    runs = findings["runs"]
    if len(runs) > 1 and findings["basins"]:
        top = findings["basins"][0]
        level = "good" if top["share"] >= 0.5 else "warning"
        yield _say(
            level, f"{top['runs']} of {len(runs)} runs agree on the best cost, {_number(top['cost'])}.", runs=top["runs"], of=len(runs)
        )


def _parameters(findings):
    by = {}
    for p in findings["parameters"]:
        by.setdefault(p["status"], []).append(p)
    total = sum(len(v) for k, v in by.items() if k != "fixed")
    good = by.get("determined", [])
    if good:
        listed = ", ".join(_estimate(p) for p in good[:8]) + (f" and {len(good) - 8} more" if len(good) > 8 else "")
        yield _say(
            "good" if len(good) == total else "info",
            f"The data determine {len(good)} of {total} parameters: {listed}.",
            determined=len(good),
        )
    for p in by.get("weak", []):
        yield _say("warning", f"{p['name']} is only roughly known: {_estimate(p)}.", value=p["value"], standard_error=p["standard_error"])
    for p in by.get("flat", []):
        yield _say(
            "bad",
            (
                f"{p['name']} is not determined: the data allow nearly the whole range from {_number(p['lower_bound'])} "
                f"to {_with_unit(p['upper_bound'], p['unit'])}."
            ),
            value=p["value"],
        )
    for p in by.get("at bound", []):
        side = "lower" if p["at_bound"] == "lower" else "upper"
        yield _say(
            "warning",
            (
                f"{p['name']} ended on its {side} bound, {_with_unit(p['value'], p['unit'])}: the data pull it further. "
                "Widen the bound if physics allows, else take it out of the model."
            ),
            value=p["value"],
        )


def _estimate(p) -> str:
    error = p["standard_error"]
    if not error:
        return f"{p['name']} = {_with_unit(p['value'], p['unit'])}"
    digits = max(0, 1 - int(np.floor(np.log10(error)))) if error < 10 else 0
    if p["value"] and (abs(p["value"]) < 1e-3 or abs(p["value"]) >= 1e5):
        power = int(np.floor(np.log10(abs(p["value"]))))
        scaled = error / 10.0**power
        digits = max(0, 1 - int(np.floor(np.log10(scaled))))
        body = f"({p['value'] / 10.0**power:.{digits}f} ± {scaled:.{digits}f})e{power}"
    else:
        body = f"{p['value']:.{digits}f} ± {error:.{digits}f}"
    return f"{p['name']} = {body} {p['unit'] or ''}".rstrip()


def _combinations(findings):
    for c in findings["combinations"]:
        if len(c["weights"]) > 1:
            yield _say("warning", c["sentence"], relative_sd=c["relative_sd"])


def _residuals(findings):
    for row in findings["residual_tests"]:
        where = _where(findings, row)
        r1 = row["autocorrelation"][1] if len(row["autocorrelation"]) > 1 else 0.0
        if row["white"]:
            yield _say(
                "good",
                f"The residuals of {where} are white (p = {row['p_value']:.2g}): no dynamics are left to explain.",
                p_value=row["p_value"],
            )
        else:
            text = (
                f"The residuals of {where} are not white (correlation {r1:.2f} from one sample to the next); "
                "standard errors account for it, but something systematic is missing"
            )
            left = [i for i, c in row["cross"].items() if not c["independent"]]
            text += (
                f", and it depends on {', '.join(left)}: the model's response to it is incomplete."
                if left
                else "; it does not follow the inputs: look for disturbances, drift or sensor effects."
            )
            yield _say("warning", text, correlation=r1)


def _noise(findings):
    for record in findings["recordings"]:
        for name, o in record["outputs"].items():
            part = np.array(o["part"]) == "fit"
            if part.sum() < 20:
                continue
            residual = (np.array(o["measured"], dtype=float) - np.array(o["simulated"], dtype=float))[part]
            noise, rms = white_part(residual), float(np.sqrt(np.nanmean(residual**2)))
            if not np.isfinite(noise) or noise == 0 or rms == 0:
                continue
            ratio = rms / noise
            row = {"recording": record["name"], "output": name}
            text = (
                f"Sample-to-sample noise of {_where(findings, row)} is about {_with_unit(noise, o['unit'])}; "
                f"the residual is {ratio:.1f} times that"
            )
            if ratio < 1.2:
                yield _say("good", text + ": the fit is at the noise floor.", noise=noise, ratio=ratio)
            else:
                yield _say("info", text + ", so a better model could still gain.", noise=noise, ratio=ratio)


def _steps(findings):
    for name, o in findings["simulation"].get("outputs", {}).items():
        if not o["rms_residual"]:
            continue
        share = o["rms_error"] / o["rms_residual"]
        level = "good" if share < 0.05 else "warning"
        end = "negligible" if share < 0.05 else "not negligible: ask for more substeps"
        yield _say(
            level,
            (
                f"The simulation of {name} is exact to {_with_unit(o['max_error'], o['unit'])} at worst "
                f"({findings['simulation']['checked_with']}), {100 * share:.2g} % of the residual: {end}."
            ),
            max_error=o["max_error"],
            share=share,
        )


def _failures(findings):
    failed = sum(r["failures"] for r in findings["runs"])
    tried = sum(r["evaluations"] for r in findings["runs"])
    if failed:
        yield _say("info", f"{failed} of {tried:.0f} evaluations could not be simulated and were passed over.", failures=failed)
