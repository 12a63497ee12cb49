"""One evaluation, gradient and Jacobian of a stiff plant with twelve parameters, in one run, against scipy and
diffrax."""

import numpy as np

import plantfit.runtime  # noqa: F401
from benchmarks.plant import PARAMETERS, model, record
from benchmarks.rivals import diffrax_functions, scipy_bdf
from benchmarks.timing import Timing, timed
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal

import jax.numpy as jnp


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    samples, repeats = 20_000, 5 if quick else 15
    t, u = record(samples)
    reference = scipy_bdf(t[:2000], u[:2000], 1e-9, 1e-11)()
    target = np.sin(t)
    signals = {"u": Signal(u), "y": Signal(target)}
    problem = Problem(model(), Recording(t, signals), substeps=4)
    z = jnp.asarray(problem.space.cube(problem.space.vector(PARAMETERS)))
    data, compiled = problem.arguments, problem.compiled
    single, batch = (
        z[None, :],
        jnp.clip(z + 0.01 * jnp.asarray(np.random.default_rng(0).normal(size=(20, z.size))), 0.0, 1.0),
    )
    p = {k: jnp.asarray(v) for k, v in PARAMETERS.items()}
    part = samples // (10 if quick else 4)
    their_cost, their_gradient, their_outputs = diffrax_functions(t[:part], u[:part], target[:part])
    scipy_run = scipy_bdf(t[:part], u[:part])

    def whole(timing: Timing) -> Timing:
        return Timing(timing.first, timing.median * samples / part)

    rows: dict[str, Timing] = {
        "evaluation": timed(lambda: compiled["costs"](single, data), repeats),
        "gradient": timed(lambda: compiled["values_and_gradients"](single, data), repeats),
        "jacobian": timed(lambda: compiled["blocks"](z, data), repeats),
        "batch of 20": timed(lambda: compiled["costs"](batch, data), repeats),
        "diffrax evaluation": whole(timed(lambda: their_cost(p), 5)),
        "diffrax gradient": whole(timed(lambda: their_gradient(p), 5)),
        "scipy BDF evaluation": whole(timed(scipy_run, 5)),
    }
    ours = problem.predict(problem.space.physical(z))["y"]
    answers = {
        "evaluation": ours,
        "diffrax evaluation": np.asarray(their_outputs(p)),
        "scipy BDF evaluation": scipy_run(),
    }
    errors = {name: np.sqrt(np.mean((y[: len(reference)] - reference) ** 2)) for name, y in answers.items()}
    print(f"{samples} samples, two states, twelve parameters; diffrax and scipy timed on {part} samples and scaled up")
    print(f"{'':24}{'first call':>12}{'median':>12}{'rms error':>14}")
    for name, timing in rows.items():
        error = f"{errors[name]:14.1e}" if name in errors else ""
        print(f"{name:24}{timing.first:10.2f} s{1000 * timing.median:9.2f} ms{error}")
    one = rows["evaluation"].median
    return {
        "gradient_over_evaluation": rows["gradient"].median / one,
        "jacobian_over_evaluation": rows["jacobian"].median / one,
        "scipy_bdf_over_plantfit": rows["scipy BDF evaluation"].median / one,
        "diffrax_over_plantfit": rows["diffrax evaluation"].median / one,
        "diffrax_gradient_over_plantfit_gradient": rows["diffrax gradient"].median / rows["gradient"].median,
        "batch20_per_candidate_over_evaluation": rows["batch of 20"].median / 20 / one,
        "evaluation_ms": 1000 * one,
    }
