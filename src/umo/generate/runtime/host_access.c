/* host_access.c: what a program on the host asks of a machine that was compiled as a shared library. */
#include "machine.h"

size_t host_size(void)
{
    return sizeof(umo_machine);
}

size_t host_real_size(void)
{
    return sizeof(umo_real);
}

double host_value(const umo_machine *m, int16_t object)
{
    return (double)m->objects[object].value;
}

double host_pending(const umo_machine *m, int16_t place)
{
    return (double)m->outputs[place].pending;
}

double host_velocity(umo_machine *m, int16_t object)
{
    umo_real velocity = (umo_real)NAN;
    (void)umo_velocity(&m->objects[object], &velocity);
    return (double)velocity;
}

int32_t host_raw(const umo_machine *m, int16_t object)
{
    return m->objects[object].raw;
}

int host_quality(const umo_machine *m, int16_t object)
{
    return m->objects[object].quality;
}

int host_inhibited(const umo_machine *m, int16_t place)
{
    return m->outputs[place].inhibited;
}

int host_fault_object(const umo_machine *m)
{
    return m->core.fault_object;
}

int host_equipment_fault(const umo_machine *m, int16_t number)
{
    return m->equipment[number].fault;
}

int host_changed(const umo_machine *m)
{
    return m->core.changed;
}

int host_given(const umo_machine *m)
{
    return m->core.given;
}

void host_referenced(umo_machine *m, int16_t object, int known)
{
    umo_referenced(&m->objects[object], known != 0);
}

umo_fault host_set_reading(umo_machine *m, int16_t object, double value)
{
    return umo_set_reading(&m->objects[object], (umo_real)value);
}
