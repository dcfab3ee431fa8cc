"""The paper's experiments, run again: what there is to run, how, what came out, and the report of it."""
