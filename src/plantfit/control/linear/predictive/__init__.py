"""Controllers that plan ahead within limits: a quadratic program every sample."""
