"""Losses on positive groups: pure functions of (features, groups).

`features` holds the unit descriptors of all scans stacked; `groups.member` indexes its rows.
The paper's form is the default; `squared=True` is that of its public code.
"""
