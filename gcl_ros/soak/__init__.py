"""A long run over real DDS in which everything around the node goes wrong, one thing at a time.

`faults` draws what goes wrong when, from a seed; `publisher` is one vehicle; `machine` does to
processes what must be done to them; `observer` holds what the node says against the truth;
`recording` writes a bag with no room for it. `make soak` runs `python -m gcl_ros.soak`.
"""
