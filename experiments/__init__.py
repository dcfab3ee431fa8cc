"""The paper's experiments, run again: what there is to run, how, what came out, and the report of it.

`cruise reproduce` and `cruise sweep` run them. They are part of a checkout, not of the installed package.
"""
