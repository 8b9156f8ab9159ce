/* umo_equipment.c: parts of the machine that fail alone, as in umo.cycle.equipment. What fails in one is its fault: its
 * actuators go to their defaults, its laws are not called, and the others go on. */
#include "umo.h"

/* Containment.is_in_fault: it, or what is around it. -1: the machine itself, which never is. */
bool umo_in_fault(const umo_core *c, int16_t number)
{
    for (; number >= 0; number = c->plan->equipment_traits[number].outer)
        if (c->equipment[number].fault)
            return true;
    return false;
}

static bool within(const umo_core *c, int16_t inner, int16_t outer)
{
    while (inner >= 0 && inner != outer)
        inner = c->plan->equipment_traits[inner].outer;
    return inner == outer;
}

/* A fault in equipment takes effect with umo_enter_faults; the first one of a period is told. */
void umo_raise_in(umo_core *c, int16_t number, umo_fault fault, int16_t object)
{
    umo_equipment *equipment = &c->equipment[number];
    if (equipment->raised)
        return;
    equipment->raised = fault;
    equipment->raised_object = object;
}

/* Whether the failure of an object is one of its equipment. Before the first period it is one of the machine. */
bool umo_contains(umo_object *o, umo_fault fault)
{
    int16_t number = o->traits->equipment;
    if (number < 0 || o->core->number == 0)
        return false;
    umo_raise_in(o->core, number, fault, (int16_t)(o - o->core->objects));
    return true;
}

void umo_forget_raised(umo_core *c)
{
    for (int16_t i = 0; i < c->plan->equipment; i++)
        c->equipment[i].raised = UMO_OK;
}

static bool enter(umo_core *c, int16_t number)
{
    umo_equipment *equipment = &c->equipment[number];
    equipment->begins = equipment->raised && !umo_in_fault(c, number);
    if (equipment->begins) {
        equipment->fault = equipment->raised;
        equipment->fault_object = equipment->raised_object;
    }
    equipment->raised = UMO_OK;
    return equipment->begins;
}

static bool begins(const umo_core *c, int16_t number)
{
    for (; number >= 0; number = c->plan->equipment_traits[number].outer)
        if (c->equipment[number].begins)
            return true;
    return false;
}

/* Containment.enter: actuators first, in stop order, then what stands in the parts. */
void umo_enter_faults(umo_core *c)
{
    const UMO_FLASH umo_plan *plan = c->plan;
    bool any = false;
    for (int16_t i = 0; i < plan->equipment; i++) /* the outer before the inner */
        any = enter(c, i) || any;
    if (!any)
        return;
    umo_restrict(c);
    for (int16_t i = 0; i < plan->outputs; i++) {
        umo_object *o = &c->objects[plan->output_objects[plan->stop_order[i]]];
        if (begins(c, o->traits->equipment))
            umo_rest(o);
    }
    c->changed = true;
    int16_t fault_object = c->fault_object;
    for (int16_t i = 0; i < plan->equipment; i++)
        if (c->equipment[i].begins && plan->equipment_traits[i].enter)
            plan->equipment_traits[i].enter((umo_machine *)(void *)c);
    c->fault_object = fault_object;
}

/* Containment._is_unread */
static bool unread(const umo_object *o)
{
    return !o->output && !(o->traits->flags & (UMO_MARKS | UMO_ASYNCHRONOUS)) && o->quality == UMO_BAD;
}

/* Containment._initialize */
static void initialize(umo_object *o)
{
    if (o->output) {
        umo_rest(o);
    } else if (o->failed) {
        o->failed = false;
        if (o->conditioning)
            umo_begin_conditioning(o->conditioning);
        if (o->traits->flags & UMO_INCREMENTAL)
            umo_referenced(o, false);
    }
}

/* Containment._read_slow: a sensor of a part with a rate of its own may not have been read since it could not be. */
static void read_slow(umo_core *c, int16_t number)
{
#ifdef UMO_GROUPS
    for (int16_t k = 0; k < c->plan->inputs; k++) {
        umo_object *o = &c->objects[k];
        if (o->traits->group != UMO_WHOLE && within(c, o->traits->equipment, number) && unread(o))
            umo_take_again(c, k);
    }
#else
    (void)c, (void)number;
#endif
}

static bool concerns(const umo_core *c, int16_t each, int16_t number)
{
    return c->equipment[each].fault && (number < 0 || within(c, each, number) || within(c, number, each));
}

/* Containment.clear: of this equipment, of what is around it and in it; -1: of all. False, and none is cleared, while
 * a sensor of it cannot be read. */
bool umo_clear(umo_core *c, int16_t number)
{
    const UMO_FLASH umo_plan *plan = c->plan;
    for (int16_t i = 0; i < plan->equipment; i++) {
        if (!concerns(c, i, number))
            continue;
        read_slow(c, i);
        for (int16_t k = 0; k < plan->objects; k++)
            if (within(c, c->objects[k].traits->equipment, i) && unread(&c->objects[k]))
                return false;
    }
    for (int16_t i = 0; i < plan->equipment; i++) {
        if (!concerns(c, i, number))
            continue;
        for (int16_t k = 0; k < plan->objects; k++)
            if (within(c, c->objects[k].traits->equipment, i))
                initialize(&c->objects[k]);
        c->equipment[i].fault = UMO_OK;
    }
    umo_restrict(c);
    return true;
}
