"""Whoever looks at a running machine from outside, and commands it: other programs (`clients.remote`), faces for other
protocols, fleets, and the page. The command `umo` is a package beside this one, `umo_command`.

What may be commanded is in `umo.operation.commands`.
"""
