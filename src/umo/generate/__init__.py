"""C from control code: controllers (`umo new controller`), compiled laws, and parts of machines on controllers of their
own with their link (`generate.split`). The meaning that is translated is that of the objects and the cycle."""
