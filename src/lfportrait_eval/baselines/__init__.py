"""Published methods that ours are compared with: on single pictures (`transfer`), on a `field`.

They are found by entry points (`lfportrait.plugins`), as those of any other package are.
"""
