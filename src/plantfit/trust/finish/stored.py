"""What finishing found for a stored study, as bytes of its store: an answer that is opened again is not finished again.

Finishing is a pure function of the problem, of the runs and of this plantfit on this machine. `finish_key` is a digest
of all of them, so that what was found is used where all are the same, and found anew where one is another. Steps,
scales, strengths of smoothing and the ends of the runs are kept to the last bit; all else of the final problem is made
of the problem itself.
"""

import hashlib
import json
import zlib
from base64 import b64decode, b64encode
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import PlantfitError
from plantfit.native.kept_programs import described
from plantfit.optimize.contract import RunResult
from plantfit.problem.correlated.filtered_answer import Filtered
from plantfit.problem.measure.scale_source import ScaleSource
from plantfit.problem.problem import Problem
from plantfit.study.store.codec import to_blob, to_json
from plantfit.study.versions import cpu_model, versions

EDITION = 3  # of the bytes below
DIGEST = hashlib.sha256().digest_size


def finish_key(problem: Problem, runs: Sequence[RunResult], wishes: str = "") -> str | None:
    """A digest of all that the finishing of these runs depends on, for a problem whose steps are not chosen yet.

    `wishes` are other things that it depends on, as text. None where the problem holds code of other packages, which
    may change without a sign.
    """
    simulator, smoothing = problem.predictor.simulator, problem.smoothing
    about = described(
        (
            problem.model, problem.experiments, problem.space, problem.begins, problem.substeps_chosen, problem.scales,
            problem.scale_sources, problem.weights, problem.mesh,
            None if simulator is None else (simulator.stepper, simulator.substeps, simulator.interpolated),
            None if smoothing is None else (smoothing.strengths, smoothing.asked),
        ),
        large=True,
    )  # fmt: skip
    if about is None:
        return None
    of = (EDITION, sorted(versions().items()), cpu_model(), len(runs), *([wishes] if wishes else []))
    digest = hashlib.sha256(about + repr(of).encode())
    for r in runs:
        told = to_json([r.method, r.run, r.seed, r.evaluations, r.status, r.failures, r.extra])
        for part in (told.encode(), to_blob(r.x), to_blob([r.cost])):
            digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


def finish_bytes(key: str, final: Problem, results: Sequence[RunResult]) -> bytes:
    """The final problem and the ends of its runs, sealed by a digest."""
    simulator, smoothing = final.predictor.simulator, final.smoothing
    found = {
        "steps": None if simulator is None else [simulator.stepper, simulator.substeps],
        "mesh": {name: _text(t) for name, t in final.mesh.items()},
        "scales": {output: float(scale) for output, scale in final.scales.items()},
        "sources": {output: list(source) for output, source in final.scale_sources.items()},
        "starts": final.start_corrections,
        "strengths": None
        if smoothing is None
        else [[*name, float(value)] for name, value in smoothing.strengths.items()],
        "filtered": None if final.filtered is None else _filtered_text(final.filtered),
        "why_not": final.not_weighted,
        "x": _text(np.array([r.x for r in results])),
        "cost": _text([r.cost for r in results]),
        "extra": [dict(r.extra) for r in results],
    }
    body = zlib.compress(to_json(found).encode())
    return _seal(key, body) + body


def finish_of_bytes(
    content: Any, key: str, problem: Problem, runs: Sequence[RunResult]
) -> tuple[Problem, list[RunResult]] | None:
    """The inverse of `finish_bytes` for the problem and the runs that `key` is of; None for bytes that are not
    whole."""
    if not isinstance(content, bytes) or content[:DIGEST] != _seal(key, content[DIGEST:]):
        return None
    try:
        found = json.loads(zlib.decompress(content[DIGEST:]))
        return _final(problem, found), _results(runs, found)
    except (zlib.error, ValueError, LookupError, TypeError, AttributeError, PlantfitError):
        return None  # a key of an edition that was forgotten to be raised: it is found anew


def _final(problem: Problem, found: dict[str, Any]) -> Problem:
    simulator = problem.predictor.simulator
    if simulator is not None:
        stepper, substeps = found["steps"]
        problem = problem.with_simulator(replace(simulator, stepper=stepper, substeps=substeps))
    if found["mesh"] or problem.mesh:
        problem = problem.with_mesh(
            {name: _values(found["mesh"][name]) for name in problem.whole_drives if name in found["mesh"]}
        )
    if found["starts"]:
        problem = problem.with_starts(found["starts"])
    if found["strengths"] is not None:
        problem = problem.with_smoothing(
            {(parameter, signal): value for parameter, signal, value in found["strengths"]}
        )
    chosen = {output: ScaleSource(*source) for output, source in found["sources"].items()}
    for source in {s: None for output, s in chosen.items() if s != problem.scale_sources[output]}:
        problem = problem.with_scales(
            {output: found["scales"][output] for output, s in chosen.items() if s == source}, source
        )
    if found.get("filtered") is not None:
        return problem.with_filtered(_filtered(found["filtered"], problem.space.dimension))
    return problem.with_answer(None, found["why_not"]) if found.get("why_not") else problem


def _filtered_text(found: Filtered) -> dict[str, Any]:
    return {
        "z": _text(found.z), "values": _text(found.values), "covariance": _text(found.covariance),
        "interval": {n: list(ends) for n, ends in found.interval.items()},
        "ahead": {name: {o: _text(y) for o, y in own.items()} for name, own in found.ahead.items()},
        "told": dict(found.told),
    }  # fmt: skip


def _filtered(told: dict[str, Any], d: int) -> Filtered:
    interval = {n: (low, high) for n, (low, high) in told["interval"].items()}
    ahead = {name: {o: _values(y) for o, y in own.items()} for name, own in told["ahead"].items()}
    covariance = _values(told["covariance"]).reshape(d, d)
    return Filtered(_values(told["z"]), _values(told["values"]), covariance, interval, ahead, told["told"])


def _results(runs: Sequence[RunResult], found: dict[str, Any]) -> list[RunResult]:
    x, cost = _values(found["x"]).reshape(len(runs), -1), _values(found["cost"])
    return [
        replace(r, x=z, cost=float(f), extra=extra)
        for r, z, f, extra in zip(runs, x, cost, found["extra"], strict=True)
    ]


def _seal(key: str, body: bytes) -> bytes:
    return hashlib.sha256(key.encode() + body).digest()


def _text(values: Any) -> str:
    return b64encode(to_blob(values)).decode()


def _values(text: str) -> np.ndarray:
    return np.frombuffer(b64decode(text), "<f8").astype(float)  # a copy that can be written, as arrays of a problem are
