"""What a step response is judged by, and controllers tuned on a family of plants."""
