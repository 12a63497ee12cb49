"""Which of several models of the same data: what they predict of unseen samples, information criteria, and what may
be said of it."""
