"""Motor of a mobile robot: identified on a virtual bench, then a discrete PID tuned by 300 000 closed loops and by
far fewer."""
