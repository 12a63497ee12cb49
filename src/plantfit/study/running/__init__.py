"""Who works on a study: tasks, workers, heartbeats, checkpoints, progress."""
