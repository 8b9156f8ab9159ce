/* umo_groups.c: parts that have rates of their own, as in umo.cycle.rate_groups and umo.cycle.part_periods. Once the
 * outputs of the machine's own rate were sent, those that are due act, the fastest first, and the outputs of each are
 * sent. */
#include "umo.h"

#ifdef UMO_GROUPS

static bool is_asynchronous(const umo_object *o)
{
    return (o->traits->flags & UMO_ASYNCHRONOUS) != 0;
}

/* What is sent next: the outputs of a group. Asynchronous ones do not wait. */
static void choose_outputs(umo_core *c, int16_t group)
{
    c->sending = group;
    for (int16_t i = 0; i < c->plan->outputs; i++) {
        umo_object *o = &c->objects[c->plan->output_objects[i]];
        o->moves = o->traits->group == group || is_asynchronous(o);
    }
}

/* PartPeriods._read: the inputs of the machine's own rate; all where no groups have followed the period before. */
void umo_choose_whole(umo_core *c)
{
    for (int16_t i = 0; i < c->plan->inputs; i++) {
        int16_t group = c->objects[i].traits->group; /* in the condition avr-gcc 5.4 would load half of it, and crash */
        c->objects[i].moves = c->sampled || group == UMO_WHOLE;
    }
    c->sampled = true;
    c->unsent = UMO_OK;
    choose_outputs(c, UMO_WHOLE);
}

/* PartGroup.schedule, PartClock.step: whether it is due. After missed ticks it acts once, and its grid stays. */
static bool begins(umo_core *c, int16_t i)
{
    umo_group *group = &c->groups[i];
    group->acts = c->number >= group->due;
    if (!group->acts)
        return false;
    for (group->ticks = 0; group->due <= c->number; group->ticks++)
        group->due += c->plan->group_traits[i].every;
    group->dt = (umo_real)(c->number - group->last) * c->plan->period;
    group->last = c->number;
    return true;
}

/* The inputs of all that are due, and the guards again. */
static umo_fault begin(umo_core *c)
{
    bool any = false;
    c->sampled = false;
    for (int16_t i = 0; i < UMO_GROUPS; i++)
        any = begins(c, i) || any;
    if (!any)
        return UMO_OK;
    for (int16_t i = 0; i < c->plan->inputs; i++) {
        int16_t group = c->objects[i].traits->group;
        c->objects[i].moves = group != UMO_WHOLE && c->groups[group].acts;
    }
    umo_fault fault = umo_sample(c, c->raws_in, c->failed_in);
    umo_evaluate(c);
    return fault;
}

/* PartPeriods._send_urgent: whether anything is. */
static bool choose_urgent(umo_core *c)
{
    bool any = false;
    c->sending = UMO_OWED;
    for (int16_t i = 0; i < c->plan->outputs; i++) {
        umo_object *o = &c->objects[c->plan->output_objects[i]];
        umo_output *output = o->output;
        output->urgent = output->urgent && !is_asynchronous(o) && o->value != output->pending;
        o->moves = output->urgent;
        any = any || o->moves;
    }
    return any;
}

static void give(umo_core *c)
{
    umo_give(c);
    c->changed = true;
}

/* The next ones after those that were sent: fills raws_out and sets `changed`, where there are any. */
static umo_fault go_on(umo_core *c)
{
    umo_fault fault = c->sending == UMO_WHOLE ? begin(c) : UMO_OK;
    while (!fault && ++c->sending < UMO_GROUPS) {
        if (!c->groups[c->sending].acts)
            continue;
        fault = c->plan->group_traits[c->sending].laws((umo_machine *)(void *)c);
        if (fault)
            break;
        umo_enter_faults(c);
        choose_outputs(c, c->sending);
        give(c);
        return UMO_OK;
    }
    if (!fault && c->sending == UMO_OWED && choose_urgent(c)) {
        give(c);
        return UMO_OK;
    }
    c->sending = UMO_SENT;
    return fault ? fault : c->unsent;
}

/* Period.update from the end of a transfer on, as umo_sent. What was not accepted does not stop those that follow. */
umo_fault umo_sent_in_turn(umo_core *c, const uint8_t *failed_out)
{
    umo_fault fault = umo_sent(c, failed_out);
    if (c->sending == UMO_SENT)
        return fault;
    c->unsent = c->unsent ? c->unsent : fault;
    return c->changed ? UMO_OK : go_on(c); /* the defaults of equipment in fault do not wait */
}

void umo_start_groups(umo_core *c)
{
    c->sampled = false;
    c->unsent = UMO_OK;
    c->sending = UMO_SENT;
    for (int16_t i = 0; i < c->plan->objects; i++)
        c->objects[i].moves = true;
    for (int16_t i = 0; i < UMO_GROUPS; i++) {
        const UMO_FLASH umo_group_traits *of = &c->plan->group_traits[i];
        umo_group *group = &c->groups[i];
        group->due = of->phase ? of->phase : of->every;
        group->last = 0;
        group->dt = of->period;
        group->ticks = 1;
        group->acts = false;
    }
}

#endif
