"""PIDs for 20 process models of the literature beside SIMC and AMIGO: IAE of step and load at no larger Ms.

`python -m benchmarks.process_batch [--rows FILE] [NAME ...]`: rows are kept in the file, so that a run can be cut and
goes on.

The processes are members of the nine families of the test batch of K. Astrom, T. Hagglund, J. Process Control 14 (2004)
635, eq. 10. A rule's loop is judged by the IAE of a step of the set point and of a step of load at the input, and by
Ms, of the sampled loop. Against each rule a PID is searched as `plantfit tune` does it on one plant, with the rule's
own Ms as its limit, kept within 1.4 to 1.7, for the least mean ratio of both IAE (C. Grimholt, S. Skogestad, IFAC PID
2012, eq. 3).
"""

import argparse
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.steps.robust import stacked_controllers
from plantfit.control.tune.forms.pid_form import pid_form
from plantfit.control.tune.frequency import frequencies, margins, sampled_response
from plantfit.control.tune.loop_design import COARSE, FINE, course_seconds
from plantfit.control.tune.loop_scores import Judge, StepAndLoad
from plantfit.control.tune.one_loop import OneLoop
from plantfit.control.tune.plant_checks import sign_of
from plantfit.control.tune.reduction import Reduced, integrators, reduced, slowest
from plantfit.control.tune.rules import rule_gains
from plantfit.control.tune.searching.figures import weights_of
from plantfit.control.tune.searching.search import ROOM, Search
from plantfit.control.tune.wishes import Wishes
from plantfit.models.text.equations import equations

import jax

LOW, HIGH = 1.4, 1.7  # of Ms, between which loops are compared
SAME = 1e-6  # the search may end at the rule itself, whose gains have gone through the cube and back
BUDGET = 400
SAMPLES = 2000  # of step and load together, at most


@dataclass(frozen=True)
class Process:
    """A model as text with the output z and the input u, and how it is written as a transfer function."""

    written: str
    text: str
    parameters: dict[str, float]


def chain(written: str, lags: list[float], dead: float = 0.0, ahead: str = "") -> Process:
    """Lags one after the other behind a dead time; `ahead` is the output where it is not the last lag."""
    rows, last = [], "delay(u, L)" if dead else "u"
    for k in range(len(lags)):
        rows.append(f"x{k}' = ({last} - x{k})/t{k}")
        last = f"x{k}"
    values = {f"t{k}": t for k, t in enumerate(lags)} | ({"L": dead} if dead else {})
    return Process(written, "\n".join([*rows, f"z = {ahead or last}"]), values)


def processes() -> dict[str, Process]:
    """By name: family and member."""
    found = {f"P1 T={t:g}": chain(f"e^-s/(1 + {t:g}s)", [t], 1.0) for t in (0.1, 1.0, 4.0, 20.0)}
    found |= {f"P2 T={t:g}": chain(f"e^-s/(1 + {t:g}s)^2", [t, t], 1.0) for t in (0.1, 1.0, 10.0)}
    found |= {f"P3 T={t:g}": chain(f"1/((s + 1)(1 + {t:g}s)^2)", [1.0, t, t]) for t in (0.2, 2.0)}
    found |= {f"P4 n={n}": chain(f"1/(s + 1)^{n}", [1.0] * n) for n in (3, 4, 8)}
    found |= {
        f"P5 a={a:g}": chain(f"1/((1 + s)(1 + {a:g}s)(1 + {a:g}^2 s)(1 + {a:g}^3 s))", [a**k for k in range(4)])
        for a in (0.2, 0.5)
    }
    tank = "a' = (delay(u, L) - a)/T1\ny' = a\nz = y"
    found["P6 L=0.3"] = Process("e^-0.3s/(s (1 + 0.7s))", tank, {"L": 0.3, "T1": 0.7})
    found["P7 T=5"] = chain("5e^-0.3s/((1 + 5s)(1 + 0.7s))", [5.0, 0.7], 0.3, ahead="t0*x1")
    for a in (0.3, 1.0):
        inverse = chain(f"(1 - {a:g}s)/(s + 1)^3", [1.0] * 3, ahead="x2 - a*(x1 - x2)/t2")
        found[f"P8 a={a:g}"] = Process(inverse.written, inverse.text, inverse.parameters | {"a": a})
    waves = "p' = u - p\nq' = v\nv' = (p - q - 1.4*T*v)/T^2\nz = q"
    found |= {
        f"P9 T={t:g}": Process(f"1/((s + 1)({t:g}^2 s^2 + {1.4 * t:g}s + 1))", waves, {"T": t}) for t in (0.5, 1.0)
    }
    return found


@dataclass(frozen=True, eq=False)
class Bench:
    """One process with everything that its loops are judged by."""

    plant: OneLoop
    rest: Any
    small: Reduced
    wishes: Wishes
    judge: Judge

    @classmethod
    def of(cls, process: Process) -> "Bench":
        text, names = process.text, list(process.parameters)
        model = equations(text, inputs=["u"], outputs=["z"], states=_states(text), parameters=names, name="process")
        plant = OneLoop(model, "z", "u", {}, {n: np.array([v]) for n, v in process.parameters.items()})
        start, rest = (plant.at_rest(level, (-1.0, 0.0, 1.0)) for level in (0.0, 1.0))
        small = reduced(rest)
        seconds = course_seconds(small)
        period = max(small.first_order[2] / 30.0, seconds / SAMPLES)
        small = reduced(rest, 0.5 * period)
        wishes = Wishes(1.0, 1.0, 1.0, period, -1e4, 1e4, overshoot=1e3)
        form = pid_form(small, sign_of(rest)[0], wishes, {"SIMC": _rule("SIMC", small)}, None)
        return cls(
            plant, rest, small, wishes, Judge.of(plant, start, StepAndLoad(0.0, 1.0, 1.0, seconds, period), 0.0, form)
        )

    def figures(self, gains: Any) -> dict[str, float]:
        """IAE of step (s) and load (s), overshoot (%) and Ms of a PID."""
        scores = self.judge.scores(stacked_controllers([gains]))
        w = frequencies(self.wishes.period, slowest(self.small), FINE)
        form = self._form(self.wishes)
        loop = form.response(gains, w)[None, :] * sampled_response(self.rest, self.wishes.period, w)
        seen = margins(loop, w, 1 + integrators(self.rest))
        found = {"step": scores.iae, "load": scores.load_iae, "overshoot": scores.overshoot}
        return {k: float(v[0, 0]) for k, v in found.items()} | {"ms": float(seen.ms[0]), "stable": bool(seen.stable[0])}

    def _form(self, wishes: Wishes) -> Any:
        rules = {name: _rule(name, self.small) for name in ("SIMC", "AMIGO")}
        return pid_form(self.small, 1, wishes, rules, None)

    def searched(self, ms: float, sizes: tuple[float, float]) -> Any:
        """The PID of least mean IAE ratio with Ms up to `ms`."""
        wishes = replace(self.wishes, ms=1.0 + (ms - 1.0) / ROOM)
        w = frequencies(wishes.period, slowest(self.small), COARSE)
        form = self._form(wishes)
        counted: dict[str, float] = dict(zip(("iae", "load_iae"), sizes, strict=True))
        h = sampled_response(self.rest, wishes.period, w)
        search = Search(self.judge, h, w, wishes, form, counted, weights_of(wishes.minimise))
        z = search.found(form.starts, BUDGET, 1, None)
        return jax.tree.map(float, form.made(z))


def _states(text: str) -> list[str]:
    return [line.split("'")[0] for line in text.splitlines() if "'" in line]


def _rule(name: str, small: Reduced) -> Any:
    isa = rule_gains(name, small)
    assert isa is not None
    return isa


def measured(process: Process) -> dict[str, Any]:
    """Both rules, and the PID searched against each."""
    bench = Bench.of(process)
    row: dict[str, Any] = {"written": process.written}
    for name in ("SIMC", "AMIGO"):
        rule = bench.figures(_rule(name, bench.small).gains())
        limit = float(np.clip(rule["ms"], LOW, HIGH))
        ours = bench.figures(bench.searched(limit, (rule["step"], rule["load"])))
        row[name] = {
            "rule": rule,
            "limit": limit,
            "ours": ours,
            "ratio": 0.5 * (ours["step"] / rule["step"] + ours["load"] / rule["load"]),
        }
    return row


def show(rows: dict[str, Any]) -> None:
    """The table as Markdown, and how often ours is at least as good."""
    print("| process | rule | its Ms | IAE step | IAE load | ours: Ms | IAE step | IAE load | mean ratio |")
    print("|---|---|---:|---:|---:|---:|---:|---:|---:|")
    for name, row in rows.items():
        for rule in ("SIMC", "AMIGO"):
            r, o, ratio = row[rule]["rule"], row[rule]["ours"], row[rule]["ratio"]
            first = f"{name}: {row['written']}" if rule == "SIMC" else ""
            print(f"| {first} | {rule} | {r['ms']:.2f} | {r['step']:.3g} | {r['load']:.3g} | {o['ms']:.2f} | "
                  f"{o['step']:.3g} | "
                  f"{o['load']:.3g} | {ratio:.2f} |")  # fmt: skip
    for rule in ("SIMC", "AMIGO"):
        ratios = np.array([row[rule]["ratio"] for row in rows.values()])
        loads = np.array([row[rule]["ours"]["load"] / row[rule]["rule"]["load"] for row in rows.values()])
        good = (
            f"at least as good in {np.sum(ratios <= 1.0 + SAME)} of {len(ratios)}, mean ratio "
            f"{np.median(ratios):.2f} in the median"
        )
        print(f"{rule}: {good}; load alone no worse in {np.sum(loads <= 1.0)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*", help="processes, such as 'P1 T=1'; all where left out")
    parser.add_argument("--rows", type=Path, default=None, help="JSON file that keeps what is measured")
    given = parser.parse_args()
    rows = json.loads(given.rows.read_text()) if given.rows and given.rows.exists() else {}
    for name, process in processes().items():
        if name in rows or (given.names and name not in given.names):
            continue
        rows[name] = measured(process)
        print(
            f"{name}: " + ", ".join(f"{rule} {rows[name][rule]['ratio']:.3f}" for rule in ("SIMC", "AMIGO")), flush=True
        )
        if given.rows:
            given.rows.write_text(json.dumps(rows, indent=1))
    show({name: rows[name] for name in processes() if name in rows})


if __name__ == "__main__":
    main()
