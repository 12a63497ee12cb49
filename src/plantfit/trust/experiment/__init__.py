"""The next experiment: `d_optimal` designs of any kind; inputs for a study's plant by `trial_record` (what a
recording would tell), `criteria`, `shapes` (step, PRBS, multisine, chirp), `exchange` (levels of blocks), `designed`
(all together), `told`."""
