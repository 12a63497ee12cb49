"""What can be read of the paper's results, and what is misprinted in it.

Sanin-Villa, Rodriguez-Cabal, Grisales-Norena, Ramirez-Neria, Tejada, A Comparative Analysis of Metaheuristic Algorithms
for Enhanced Parameter Estimation on Inverted Pendulum System Dynamics, 2024. Its algorithms 1 to 3, tables 2 to 4 and
figures are not legible in the text that we have; the numbers below stand in its running text.
"""

# N m and seconds a run, over 1000 runs each
PUBLISHED = {
    "pso": {"time_mean": 888.4771, "time_std": 17.4958},
    "cga": {"rmse_min": 0.015039607, "rmse_mean": 0.015490795, "time_mean": 954.1851, "time_std": 18.7228},
    "salp_swarm": {
        "rmse_min": 0.015015147,
        "rmse_mean": 0.015066207,
        "rmse_std": 1.44399e-6,
        "time_mean": 916.5614,
        "time_std": 18.7228,
    },
}

ERRATA = (
    ("b1", "m1 lc1^2 + m2 lc2^2 + I1", "m1 lc1^2 + m2 l1^2 + I1", "link 2 hangs at the end of link 1"),
    ("b2", "m2 lc2^2 + l2", "m2 lc2^2 + I2", "a length cannot be added to an inertia"),
    ("b4", "m1 lc1 + m1 l1", "m1 lc1 + m2 l1", "link 2 hangs at the end of link 1"),
    ("C11", "-b3 t1' sin t2", "-b3 t2' sin t2", "M' - 2C must be skew: energy would not be conserved"),
    (
        "motor",
        "armature resistance 0.0724 ohm, torque constant 2.983 ohm",
        "kt = 0.0724 N m/A, Ra = 2.983 ohm",
        "the names are swapped; no back-EMF constant is printed: ke = kt, as in SI units, is ours",
    ),
    ("pose at 7 s", "theta1 = 3/2 pi", "theta1 = 2/3 pi", "theta1 + theta2 must be pi/2 with theta2 = -pi/6"),
    ("time of that pose", "y_f(6)", "y_f(7)", "the move begins at 4.5 s and takes 2.5 s; figure 3b is at 7 s"),
    (
        "std of SSA",
        "1.44399e-6 N m",
        "at least 1.6e-6 N m",
        "1000 runs with this minimum and this mean cannot spread less",
    ),
)
