"""The clients, which observe and command a running machine from outside: other programs (`clients.remote`), faces for
other protocols, fleets, and the page. The command `umo` is a separate package, `umo_command`.

What may be commanded is in `umo.operation.commands`.
"""
