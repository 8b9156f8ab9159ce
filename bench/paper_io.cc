// ioMan.cc, Listing 4: the device driver of row (b). A table takes the place of the switch.
#include "paper.h"

#include <iostream>

long io_registers[IO_NAMES];

static bool known(io_enum name, const char *function)
{
    if (static_cast<unsigned>(name) < static_cast<unsigned>(IO_NAMES))
        return true;
    std::cout << "No " << function << " function for that name." << std::endl;
    return false;
}

void IO_initialize(io_enum name) { known(name, "initialize"); }

void IO_finalize(io_enum name) { known(name, "finalize"); }

void IO_reset(io_enum name)
{
    if (known(name, "reset"))
        io_registers[name] = 0;
}

long IO_read(io_enum name) { return known(name, "read") ? io_registers[name] : 0; }

void IO_write(io_enum name, long value)
{
    if (known(name, "write"))
        io_registers[name] = value;
}
