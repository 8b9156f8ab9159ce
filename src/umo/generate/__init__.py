"""Generates C from control code: for controllers (`umo new controller`), for compiled laws, and for parts of machines
that run on separate controllers, with the link to these controllers (`generate.split`). The generated C has the same
meaning as the objects and the cycle in Python."""
