"""Fuzzing of everything that reads: broken and hostile input in, nothing but `GclError` out.

`seeds` makes whole inputs, `mutate` breaks them, `targets` feeds them to the readers, `sandbox`
bounds memory and time. `guided` lets atheris look for inputs that reach new code.
`make bench-fuzz` runs `python -m gcl_ros.fuzz`; the tests run a seeded thousand.
"""
