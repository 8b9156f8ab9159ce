"""Every order of messages: the real code of both ends of a link, on a transport that a schedule owns, in virtual time.

    python -m tools.message_orders                  each letter for each of the first six messages of each scenario
    python -m tools.message_orders --random 10000   at random
    python -m tools.message_orders --replay "run .WH"
    python -m tools.message_orders --planted        faults in copies of umo: which are found?

docs/decisions/0121-orders-of-messages.md
"""
