"""A heated element around 60 degC, where drift is all that is left and dead time cannot be told from zero."""
