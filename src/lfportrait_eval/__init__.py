"""Evaluation: quality metrics, speed benchmarks, user studies and published baselines.

`metrics` measures results, `baselines` are the published methods that ours are compared with,
`bench` measures speed, `study` asks people, `tables` sets all of it side by side, and `commands`
are ``lfportrait evaluate``, ``evaluate tables``, ``bench`` and ``study``. All of it imports
`lfportrait`, and nothing there imports this package: the command line finds commands and methods by
their entry points (`lfportrait.plugins`).
"""
