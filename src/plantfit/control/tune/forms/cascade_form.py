"""A cascade of a PID around a PI as a form of controller."""

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.cascade import Cascade, Ends, cascade, cascade_response
from plantfit.control.pid import Gains, Settings, checked
from plantfit.control.tune.forms.form import Form, change, spread
from plantfit.control.tune.forms.pid_form import gains_built
from plantfit.control.tune.frequency import pid_response
from plantfit.control.tune.loop_scores import Limits, slewed
from plantfit.control.tune.reduction import Reduced, slowest
from plantfit.control.tune.rules import FILTER, rule_gains
from plantfit.control.tune.wishes import Wishes
from plantfit.space import Parameter, Space

import jax.numpy as jnp


def cascade_form(
    outer: Reduced, inner: Reduced, names: tuple[str, str], wishes: Wishes, tracking_time: float | None
) -> Form:  # fmt: skip
    """A PID of the output whose command is the set point of a PI of the inner output, of one plant reduced from the
    input to each of both.

    Searched in K, Ti, Td, set-point weight and filter of the outer and K, Ti of the inner one. Its starts are SIMC for
    the inner loop, and for the outer one lags of the plant with the inner loop's time added to its dead time.
    """
    fast = rule_gains("SIMC", inner, derivative=False)
    assert fast is not None
    k, late = outer.first_order[0] / inner.first_order[0], outer.first_order[2] + inner.first_order[2]
    slow, size = slowest(outer), (1.0 if outer.integrating else outer.first_order[1]) / (abs(k) * late)
    space = Space({
        "K": Parameter((size / 50, size * 50), scale="log"),
        "Ti": Parameter((0.2 * late, 30.0 * (slow + late)), scale="log"),
        "b": Parameter((0.0, 1.0)),
        "Td": Parameter((0.01 * late, 2.0 * slow), scale="log"),
        "ratio": Parameter((2.0, 30.0), scale="log"),
        "k": Parameter((abs(fast.K) / 30, abs(fast.K) * 30), scale="log"),
        "ti": Parameter((0.1 * inner.first_order[2], 30.0 * slowest(inner)), scale="log"),
    })  # fmt: skip
    gains_of = gains_built(tuple(space.names), tuple(space.log))
    gain, place = np.sign(inner.first_order[0]), {n: i for i, n in enumerate(space.names)}

    def built(z, data):
        values = space.physical(z)
        own = gain * values[place["k"]]
        return Cascade(
            gains_of(z, data), Gains(own, own / values[place["ti"]], 0.0 * own, 1.0 + 0.0 * own, 0.0 * own, 0.0 * own)
        )

    def response(parameters: Cascade, w, xp=np):
        outer, inner = (pid_response(g, wishes.period, w, xp) for g in parameters)
        return cascade_response(outer, inner, xp)

    follow = checked(Settings(wishes.period, wishes.lower, wishes.upper, wishes.anti_windup, tracking_time)).follow
    usual = {"Ti": min(outer.first_order[1], 8.0 * late), "ratio": FILTER, "k": abs(fast.K), "ti": fast.Ti}
    known = [
        usual | {"K": size * share, "b": b, "Td": td, "k": abs(fast.K) * more}
        for share in (0.25, 0.5, 1.0) for b in (0.0, 1.0)
        for td in (0.02 * late, 0.3 * late) for more in (0.5, 1.0, 2.0)
    ]  # fmt: skip
    rules = [space.cube(np.array([point[n] for n in space.names])) for point in known]
    starts = np.clip(np.concatenate([rules, spread(space)]), 0.0, 1.0)
    loop = slewed(cascade(wishes.period, wishes.anti_windup, *names), change(wishes))
    given = Limits(wishes.lower, wishes.upper, follow), Ends(wishes.inner_lower, wishes.inner_upper)
    data = (space.lower, space.upper, float(np.sign(k)))
    return Form(
        "cascade", space, built, response, loop, lambda _: 0, starts, inner=True, integrators=2, settled=True,
        data=data, given=tuple(type(g)(*(jnp.asarray(float(v)) for v in g)) for g in given),
    )  # fmt: skip
