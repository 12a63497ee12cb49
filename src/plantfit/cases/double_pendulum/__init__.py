"""Double pendulum of DFKI, both joints driven, identification runs on real hardware."""
