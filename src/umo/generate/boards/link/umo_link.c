/* umo_link.c: the controller's end of the link. Numbers are as in the memory of the controller, the least byte first. */
#include <string.h>

#include "umo_link.h"

static umo_link *the_link; /* of ask_host, which is given the machine */

static uint16_t u16(const uint8_t *at)
{
    return (uint16_t)(at[0] | at[1] << 8);
}

static void put(umo_link *l, const void *from, uint16_t size)
{
    if (l->length + size <= LINK_LONGEST)
        memcpy(&l->out[l->length], from, size);
    l->length = (uint16_t)(l->length + size);
}

static void put_byte(umo_link *l, uint8_t value)
{
    put(l, &value, 1);
}

static void put_u16(umo_link *l, uint16_t value)
{
    put(l, &value, 2);
}

static void send(umo_link *l)
{
    umo_frame_send(l->out, l->length, link_put);
    link_end();
}

void umo_link_begin(umo_link *l, umo_machine *m, int32_t *raws_in, uint8_t *failed_in, int32_t *raws_out)
{
    memset(l, 0, sizeof *l);
    l->machine = m;
    l->raws_in = raws_in;
    l->failed_in = failed_in;
    l->raws_out = raws_out;
    l->fault_object = -1;
    the_link = l;
    umo_frame_begin(&l->reader, l->in, sizeof l->in);
}

static void ask(umo_link *l, uint16_t call)
{
    l->asking = true;
    if (++l->asks == 0)
        l->asks = 1; /* 0: nothing */
    l->call = (uint8_t)call;
}

/* The host has planned: what else is wanted is asked for. */
static void planned(umo_link *l, uint16_t number)
{
    if (!l->asking || number != l->asks)
        return;
    l->asking = l->wanted[l->call] = false;
    for (int32_t call = 0; call < LINK_CALLS && !l->asking; call++)
        if (l->wanted[call])
            ask(l, (uint16_t)call);
}

/* The host is asked to plan, one thing after the other, and the law goes on meanwhile. */
static umo_fault ask_host(umo_machine *m, uint16_t call, uint16_t object, umo_real *numbers, uint16_t count)
{
    umo_link *l = the_link;
    (void)m;
    (void)object;
    if (l->mode != LINK_RUNNING || count > LINK_NUMBERS)
        return UMO_NO_HOST;
    l->wanted[call] = true;
    l->count[call] = (uint8_t)count;
    for (uint16_t i = 0; i < count; i++)
        l->numbers[call][i] = numbers[i];
    if (!l->asking || l->call == call)
        ask(l, call);
    return UMO_OK;
}

/* What the host asks for ------------------------------------------------------------------------------------ */

static void welcome(umo_link *l, const uint8_t *body, uint16_t length)
{
    static const uint32_t hash = LINK_HASH;
    if (length != 5)
        return;
    if (!l->offered || memcmp(l->nonce, &body[1], sizeof l->nonce) != 0) { /* else it is the same greeting again */
        memcpy(l->nonce, &body[1], sizeof l->nonce);
        if (++l->offered == 0)
            l->offered = 1;
    }
    l->length = 0;
    put_byte(l, LINK_WELCOME);
    put(l, &body[1], 4);
    put_byte(l, LINK_VERSION);
    put(l, &hash, 4);
    put_byte(l, sizeof(umo_real));
    put_u16(l, l->offered);
    send(l);
}

static void set_field(umo_link *l, uint16_t number, const uint8_t *from)
{
    for (uint16_t i = link_first[number]; i < link_first[number + 1]; i++) {
        memcpy((uint8_t *)l->machine + link_places[i].offset, from, link_places[i].size);
        from += link_places[i].size;
    }
}

static uint16_t size_of_field(uint16_t number)
{
    uint16_t size = 0;
    for (uint16_t i = link_first[number]; i < link_first[number + 1]; i++)
        size = (uint16_t)(size + link_places[i].size);
    return size;
}

static void command(umo_link *l, uint16_t place, const uint8_t *from)
{
    umo_real value;
    bool taken;
    memcpy(&value, from, sizeof value);
    umo_object *o = &l->machine->objects[l->machine->core.plan->output_objects[place]];
    if (!o->output->inhibited || value == o->traits->rest)
        (void)umo_command(o, value, &taken);
}

static void reference(umo_link *l, uint16_t number, const uint8_t *from)
{
    umo_real zero_offset;
    umo_object *o = &l->machine->objects[number];
    memcpy(&zero_offset, from + 1, sizeof zero_offset);
    if (zero_offset != o->zero_offset)
        umo_shift(o, zero_offset);
    umo_referenced(o, from[0] != 0);
}

/* The size of an item after its kind and number; 0xFFFF: there is no such item. */
static uint16_t size_of(uint8_t kind, uint16_t number)
{
    if (kind == LINK_FIELD && number < LINK_FIELDS)
        return size_of_field(number);
    if (kind == LINK_COMMAND && number < MACHINE_OUTPUTS)
        return sizeof(umo_real);
    if (kind == LINK_REFERENCE && number < MACHINE_INPUTS)
        return 1 + sizeof(umo_real);
    return kind >= LINK_CLEAR && kind <= LINK_GIVEN ? 0 : 0xFFFF;
}

static void carry_out(umo_link *l, uint8_t kind, uint16_t number, const uint8_t *from)
{
    if (kind == LINK_FIELD)
        set_field(l, number, from);
    else if (kind == LINK_COMMAND)
        command(l, number, from);
    else if (kind == LINK_REFERENCE)
        reference(l, number, from);
    else if (kind == LINK_CLEAR)
        (void)machine_clear(l->machine, (int16_t)number);
    else if (kind == LINK_PLANNED)
        planned(l, number);
    else if (kind == LINK_ACKNOWLEDGE)
        machine_acknowledge(l->machine);
}

static bool is_after(uint16_t number, uint16_t other)
{
    return (int16_t)(uint16_t)(number - other) > 0;
}

/* The items from `at` on: all are whole before the first is carried out. What was given before, in a frame that was
 * carried out, is not carried out again: only its answer was lost. */
static bool items(umo_link *l, const uint8_t *body, uint16_t at, uint16_t length, bool check)
{
    while (at < length) {
        if (length - at < 3)
            return false;
        uint16_t number = u16(&body[at + 1]), size = size_of(body[at], number);
        if (size == 0xFFFF || length - at - 3 < size)
            return false;
        if (!check && body[at] == LINK_GIVEN && !is_after(number, l->heard))
            return true;
        if (!check)
            carry_out(l, body[at], number, &body[at + 3]);
        at = (uint16_t)(at + 3 + size);
    }
    return true;
}

static void inhibit(umo_link *l, const uint8_t *bits)
{
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++) {
        uint8_t bit = (uint8_t)(1 << i % 8);
        if (bits[i / 8] & bit && !(l->inhibits[i / 8] & bit))
            l->machine->core.outputs[i].due = true;
    }
    memcpy(l->inhibits, bits, sizeof l->inhibits);
}

static void start(umo_link *l)
{
    machine_init(l->machine);
    memset(l->inhibits, 0, sizeof l->inhibits);
    l->machine->core.inhibits = l->inhibits;
    l->machine->core.host_call = ask_host;
    l->asking = false;
    memset(l->wanted, 0, sizeof l->wanted);
    l->fault = machine_begin(l->machine, l->raws_in, l->failed_in, l->raws_out);
    l->fault_object = l->machine->core.fault_object;
    l->mode = l->fault ? LINK_FAULTED : LINK_RUNNING;
}

/* START and EXCHANGE: kind, session, number, then what is inhibited, and the items. STOP ends with its number. */
static void take(umo_link *l, const uint8_t *body, uint16_t length)
{
    enum { HEAD = 5, FIRST = HEAD + LINK_BITS(MACHINE_OUTPUTS) };
    bool stops = body[0] == LINK_STOP;
    if (length < (stops ? HEAD : FIRST) || (!stops && !items(l, body, FIRST, length, true)))
        return;
    uint16_t session = u16(&body[1]), number = u16(&body[3]);
    bool starts = body[0] == LINK_START;
    if (starts && l->mode == LINK_BRAKING)
        return; /* once it stands: the host says it again */
    if ((starts || stops) && session && session == l->offered && session != l->begun) {
        l->session = l->begun = session; /* STOP: of a host that has not started it, such as a guardian */
        if (starts)
            start(l);
    } else if (!l->session || session != l->session || !is_after(number, l->heard)) {
        return; /* of another session, or come twice, or too late */
    } else if (starts) {
        length = FIRST; /* said again, as its answer was lost: its items are carried out */
    }
    if (stops) {
        machine_stop(l->machine, l->raws_out);
        l->mode = LINK_RESTING;
    } else if (l->mode == LINK_RUNNING) {
        inhibit(l, &body[HEAD]);
        (void)items(l, body, FIRST, length, false);
    }
    l->heard = number;
    l->silent = 0;
    l->asked = true;
}

void umo_link_receive(umo_link *l)
{
    for (int byte = link_get(); byte >= 0; byte = link_get()) {
        if (!umo_frame_take(&l->reader, (uint8_t)byte))
            continue;
        uint8_t kind = l->in[0];
        if (kind == LINK_HELLO)
            welcome(l, l->in, l->reader.length);
        else if (kind == LINK_START || kind == LINK_EXCHANGE || kind == LINK_STOP)
            take(l, l->in, l->reader.length);
    }
}

bool umo_link_count(umo_link *l, int32_t ticks)
{
    if (l->mode != LINK_RUNNING && l->mode != LINK_BRAKING)
        return false;
    l->silent += (uint32_t)ticks;
    if (l->silent <= LINK_HOST_TIMEOUT)
        return true;
    bool ends = l->silent > LINK_HOST_TIMEOUT + LINK_BRAKING_TIMEOUT;
    if (l->mode == LINK_RUNNING) {
        l->mode = LINK_BRAKING;
        l->session = 0;
        ends = ends || machine_brake(l->machine) != UMO_OK;
    }
    if (ends || !machine_moves(l->machine))
        l->mode = LINK_HOST_GONE;
    return l->mode == LINK_BRAKING;
}

/* The answer ------------------------------------------------------------------------------------------------ */

static void put_bits(umo_link *l, int16_t count, bool (*is)(const umo_link *l, int16_t i))
{
    for (int16_t i = 0; i < count; i += 8) {
        uint8_t bits = 0;
        for (int16_t k = i; k < count && k < i + 8; k++)
            bits = (uint8_t)(bits | (is(l, k) ? 1 << (k - i) : 0));
        put_byte(l, bits);
    }
}

static bool is_failed(const umo_link *l, int16_t i)
{
    return l->failed_in[i] != 0;
}

static bool is_inhibited(const umo_link *l, int16_t i)
{
    return l->machine->core.outputs[i].inhibited;
}

static void put_objects(umo_link *l)
{
    const umo_core *c = &l->machine->core;
    put(l, l->raws_in, (uint16_t)(4 * MACHINE_INPUTS));
    put_bits(l, MACHINE_INPUTS, is_failed);
    for (int16_t i = 0; i < MACHINE_OUTPUTS; i++)
        put(l, &c->outputs[i].pending, sizeof(umo_real));
    put(l, l->raws_out, (uint16_t)(4 * MACHINE_OUTPUTS));
    put_bits(l, MACHINE_OUTPUTS, is_inhibited);
    for (int16_t i = 0; i < MACHINE_EQUIPMENT; i++)
        put_u16(l, (uint16_t)c->equipment[i].fault);
}

void umo_link_answer(umo_link *l)
{
    if (!l->asked)
        return;
    l->asked = false;
    uint32_t number = (uint32_t)l->machine->core.number;
    l->length = 0;
    put_byte(l, LINK_STATE);
    put_u16(l, l->session);
    put_u16(l, l->heard);
    put_byte(l, l->mode);
    put_u16(l, (uint16_t)l->fault);
    put_u16(l, (uint16_t)l->fault_object);
    put(l, &number, 4);
    put_u16(l, l->asking ? l->asks : 0);
    put_byte(l, l->call);
    put_byte(l, l->count[l->call]);
    put(l, l->numbers[l->call], sizeof l->numbers[l->call]);
    put_objects(l);
    for (uint16_t f = 0; f < LINK_FIELDS; f++)
        for (uint16_t i = link_first[f]; link_changes[f] && i < link_first[f + 1]; i++)
            put(l, (const uint8_t *)l->machine + link_places[i].offset, link_places[i].size);
    send(l);
}
