"""The designs along a trajectory against python-control."""

import numpy as np

import control
from plantfit.rig.lqg import Weights, scheduled_lqg

WEIGHTS = Weights((0.1, 0.0, 2.0), 3.0, 0.5, 0.02)


def plant(value):
    return np.array([[0.0, 1.0, 0.0], [value, -0.1, 1.0], [0.0, 0.3, -2.0]]), np.array([[0.0], [0.2], [1.0]])


def test_each_design_is_that_of_python_control():
    along, period = np.array([1.0, 4.0, 2.5]), 0.01
    lqg = scheduled_lqg(plant, along, period, WEIGHTS, measured=2, nodes=3)
    for k, value in enumerate(along):
        a, b = plant(value)
        held = control.c2d(control.ss(a, b, np.eye(3), 0), period)
        step, push, seen = np.asarray(held.A), np.asarray(held.B), np.eye(2, 3)
        gain = control.dlqr(step, push, np.diag([100.0, 0.0, 0.25]), 1 / 9.0)[0]
        np.testing.assert_allclose(lqg.gain[k], gain[0], rtol=1e-6)
        np.testing.assert_allclose(lqg.transition[k], step, atol=1e-12)
        np.testing.assert_allclose(lqg.input[k], push.ravel(), atol=1e-12)
        predictor = control.dlqe(step, push, seen, 0.25, 4e-4 * np.eye(2))[0]
        np.testing.assert_allclose(step @ lqg.observer[k], predictor, rtol=1e-6)


def test_between_the_nodes_the_designs_are_straight_lines():
    lqg = scheduled_lqg(plant, np.array([1.0, 1.75, 2.5, 4.0]), 0.01, WEIGHTS, measured=1, nodes=3)
    np.testing.assert_allclose(lqg.gain[1], 0.5 * (lqg.gain[0] + lqg.gain[2]))
    np.testing.assert_allclose(lqg.observer[1], 0.5 * (lqg.observer[0] + lqg.observer[2]))


def test_one_pose_needs_one_design():
    lqg = scheduled_lqg(plant, np.full(5, 2.0), 0.01, WEIGHTS, measured=2)
    assert lqg.gain.shape == (5, 3)
    assert np.all(lqg.gain == lqg.gain[0])
