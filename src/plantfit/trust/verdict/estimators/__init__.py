"""What the verdict says of answers by other estimators than least squares, and of what they would know."""
