"""Faces: a running machine in the words of another system's protocol.

A face is a process separate from the machine: it reads frames, and commands only what a client asks for. Each face
translates what the host (`umo.clients.faces.host`) gives it: the module `umo.clients.faces.face` is the whole interface
between the two.
"""
