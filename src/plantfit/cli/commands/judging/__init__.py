"""Commands that judge a study: what was understood of it, what is missing in its model, which inputs its answer rests on."""
