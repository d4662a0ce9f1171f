"""The laboratory beside the product: how good results are, how fast, and how others do it.

`metrics` measures results, `baselines` are the published methods that ours are compared with,
`bench` measures speed, `study` asks people, `tables` sets all of it side by side, and `commands`
are ``lfportrait evaluate``, ``evaluate tables``, ``bench`` and ``study``. All of it imports
`lfportrait`, and nothing there imports this package: the command line finds commands and methods by
their entry points (`lfportrait.plugins`).
"""
