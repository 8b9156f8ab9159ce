/* A box of 12 outputs that speaks Modbus TCP, made with libmodbus, and knows nothing of umo.
 *
 *     box FILE
 *
 * Serves 10 coils and 2 holding registers (the outputs), 8 discrete inputs and 4 input registers on a free port of
 * 127.0.0.1. No watchdog. Several connections are served in turns, one request of each. FILE is mapped and holds 64-bit
 * cells (bench/kills/box.py has the same list):
 *     0 PORT      said once the box listens
 *     1 FAULT     1 while a fault is switched on; its name stands in the 32 bytes from cell 12
 *     2 VALUE     of the fault
 *     3 UNTIL     ns of CLOCK_MONOTONIC at which the fault ends by itself; 0: as long as FAULT stands
 *     4 REQUESTS  taken so far
 *     5 MET       requests and connections that met a fault
 *    16 + 3 i     of output i (coils first): its value; since when it stands at its default, in ns (0 while it does
 *                 not); how often it left its default
 *
 * The faults; what is not said to be carried out changes no output, and its answer holds other values than the box has:
 *     silent       never answered
 *     mute         carried out, never answered
 *     late=MS      carried out, answered MS later
 *     split=MS     carried out, the answer in two pieces, MS apart
 *     trickle=MS   carried out, the answer byte by byte, MS apart
 *     stale        first the answer of another transaction, then it is carried out and answered
 *     twice        carried out, answered twice
 *     hangup       carried out and answered, then the connection is closed
 *     close        the connection is closed in place of an answer
 *     reset        the same, by RST
 *     refuse       all connections are closed, and nobody listens
 *     exception=N  answered by exception N
 *     garbage      bytes that are not Modbus, then the connection is closed
 *     cut=N        the first N bytes of an answer, then the connection is closed
 *     half=N       the first N bytes of an answer, and no more
 *     transaction  answered under another transaction's number
 *     unit         answered in the name of another unit
 *     protocol     answered under another protocol's number
 *     function=N   answered under function N
 *     length=N     the header announces N bytes more than there are
 *     bitcount=N   reading bits: the byte count is N whatever follows
 *     count=N      reading registers: the same
 *     fewer        reading: a well-formed answer that is one byte short
 *     trailing     reading registers: two bytes more than the byte count says
 *     echo         writing: confirms another address
 *     value        writing: confirms another value or number
 *     coil         writing a single coil: confirms the value 0x1234, which is neither on nor off
 *     stall=MS     nothing is served for MS, then all that waits, the newest connection first; ends by itself
 *     restart      nothing is served, connections stay half open; then it knows none of them: each is reset (RST)
 *     one=MS       one connection at a time; the next one is taken MS after it was closed
 */
#include <errno.h>
#include <fcntl.h>
#include <modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum { PORT, FAULT, VALUE, UNTIL, REQUESTS, MET, NAME = 12, OUTPUT = 16 };

#define COILS 10
#define WORDS 2
#define BITS 8
#define INPUTS 4   /* and one more: its clock */
#define CLOCK 8    /* ms for each count of that */
#define CELLS 64
#define MOST 64    /* connections at a time */
#define BACKLOG 5  /* of the one=MS box, too: a small device */
#define LOOK 2     /* ms between two looks at the cells */
#define HEADER 7   /* the MBAP header: transaction, protocol, length, unit */

static volatile int64_t *cells;
static modbus_t *context;
static modbus_mapping_t *own, *other; /* `other` gives the values of what is not carried out */
static int listener = -1, count;
static int client[MOST]; /* the oldest first */

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec * 1000000000LL + time.tv_nsec;
}

static void pause_ms(int64_t ms)
{
    if (ms > 0)
        usleep((useconds_t)ms * 1000);
}

static void fail(const char *what)
{
    fprintf(stderr, "box: %s: %s\n", what, errno ? strerror(errno) : "failed");
    exit(2);
}

/* The name of the fault that is switched on, "" without one. */
static const char *fault(void)
{
    if (!cells[FAULT] || (cells[UNTIL] && now() >= cells[UNTIL]))
        return "";
    return (const char *)(cells + NAME);
}

static int is(const char *name) { return strcmp(fault(), name) == 0; }

/* What it serves, and what it notes -------------------------------------------------------------------- */

static void fill(modbus_mapping_t *map, int shift)
{
    for (int i = 0; i < BITS; i++)
        map->tab_input_bits[i] = (uint8_t)((i % 3 == 0) ^ (shift != 0));
    for (int i = 0; i < INPUTS; i++)
        map->tab_input_registers[i] = (uint16_t)(1000 + 111 * i + shift);
}

static void note(void)
{
    for (int i = 0; i < COILS + WORDS; i++) {
        volatile int64_t *cell = cells + OUTPUT + 3 * i;
        int64_t value = i < COILS ? own->tab_bits[i] : own->tab_registers[i - COILS];
        if (value && !cell[0])
            cell[2]++;
        if (value)
            cell[1] = 0;
        else if (!cell[1])
            cell[1] = now();
        cell[0] = value;
    }
}

/* What libmodbus answers, caught in place of being sent, so that it can be spoiled. */
static int answer_of(const uint8_t *query, int length, modbus_mapping_t *map, int64_t exception, uint8_t *answer)
{
    int pair[2], size;
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, pair) != 0)
        fail("socketpair");
    modbus_set_socket(context, pair[0]);
    map->tab_input_registers[INPUTS] = (uint16_t)(now() / (CLOCK * 1000000));
    if (exception)
        modbus_reply_exception(context, query, (unsigned)exception);
    else
        modbus_reply(context, query, length, map);
    size = (int)recv(pair[1], answer, MODBUS_TCP_MAX_ADU_LENGTH, 0);
    close(pair[0]);
    close(pair[1]);
    if (map == own)
        note();
    return size;
}

/* Faults of one request -------------------------------------------------------------------------------- */

typedef struct {
    int socket, length, size, stays;
    const uint8_t *query;
    uint8_t answer[MODBUS_TCP_MAX_ADU_LENGTH + 4];
} Turn;

static void put(Turn *turn, int from, int to)
{
    send(turn->socket, turn->answer + from, (size_t)(to - from), MSG_NOSIGNAL);
}

static void in_pieces(Turn *turn, int piece)
{
    for (int at = 0; at < turn->size; at += piece) {
        put(turn, at, at + piece < turn->size ? at + piece : turn->size);
        pause_ms(cells[VALUE]);
    }
}

static void longer(Turn *turn, int bytes)
{
    turn->size += bytes;
    turn->answer[5] = (uint8_t)(turn->answer[5] + bytes);
}

/* Carried out as it should be, said in another way; 0 if this fault is not one of these. */
static int done_well(Turn *turn)
{
    static const char *names[] = {"", "mute", "late", "split", "trickle", "stale", "twice", "hangup", "one", NULL};
    const char *name = fault();
    int known = 0;
    for (int i = 0; names[i] != NULL; i++)
        known |= strcmp(name, names[i]) == 0;
    if (!known)
        return 0;
    if (strcmp(name, "stale") == 0) {
        turn->size = answer_of(turn->query, turn->length, other, 0, turn->answer);
        turn->answer[1]--;
        put(turn, 0, turn->size);
    }
    turn->size = answer_of(turn->query, turn->length, own, 0, turn->answer);
    if (strcmp(name, "mute") == 0)
        return 1;
    if (strcmp(name, "late") == 0)
        pause_ms(cells[VALUE]);
    if (strcmp(name, "split") == 0)
        return in_pieces(turn, 5), 1;
    if (strcmp(name, "trickle") == 0)
        return in_pieces(turn, 1), 1;
    put(turn, 0, turn->size);
    if (strcmp(name, "twice") == 0)
        put(turn, 0, turn->size);
    turn->stays = strcmp(name, "hangup") != 0;
    return 1;
}

static void leave(Turn *turn, int at_once)
{
    struct linger now_and_hard = {1, 0};
    if (at_once)
        setsockopt(turn->socket, SOL_SOCKET, SO_LINGER, &now_and_hard, sizeof now_and_hard);
    turn->stays = 0;
}

/* An answer with something wrong in its header, or less than an answer; 0 if this fault is not one of these. */
static int spoiled(Turn *turn)
{
    uint8_t *answer = turn->answer;
    int64_t value = cells[VALUE];
    if (is("transaction"))
        answer[1]++;
    else if (is("protocol"))
        answer[3] = 1;
    else if (is("length"))
        answer[5] = (uint8_t)(answer[5] + value);
    else if (is("unit"))
        answer[6]++;
    else if (is("function"))
        answer[HEADER] = (uint8_t)value;
    else if (is("exception"))
        turn->size = answer_of(turn->query, turn->length, other, value, answer);
    else if (is("cut") || is("half")) {
        turn->stays = is("half");
        turn->size = (int)value < turn->size ? (int)value : turn->size;
    } else
        return 0;
    put(turn, 0, turn->size);
    return 1;
}

/* The same for what is wrong in the body; 0 where the fault does not concern this function. */
static int spoiled_body(Turn *turn)
{
    uint8_t *answer = turn->answer;
    int function = turn->query[HEADER], reading = function <= 4, bits = function <= 2;
    if (reading && is(bits ? "bitcount" : "count"))
        answer[HEADER + 1] = (uint8_t)cells[VALUE];
    else if (reading && is("fewer")) {
        longer(turn, -1);
        answer[HEADER + 1]--;
    } else if (reading && !bits && is("trailing"))
        longer(turn, 2);
    else if (!reading && is("echo"))
        answer[HEADER + 2] ^= 1;
    else if ((!reading && is("value")) || (function == 5 && is("coil"))) {
        answer[HEADER + 3] = 0x12;
        answer[HEADER + 4] = 0x34;
    } else
        return 0;
    put(turn, 0, turn->size);
    return 1;
}

static void answer_request(Turn *turn)
{
    static const char text[] = "HTTP/1.0 400 Bad Request\r\n\r\n";
    if (*fault())
        cells[MET]++;
    if (done_well(turn) || is("silent"))
        return;
    if (is("close") || is("reset")) {
        leave(turn, is("reset"));
        return;
    }
    if (is("garbage")) {
        send(turn->socket, text, sizeof text - 1, MSG_NOSIGNAL);
        leave(turn, 0);
        return;
    }
    turn->size = answer_of(turn->query, turn->length, other, 0, turn->answer);
    if (spoiled(turn) || spoiled_body(turn))
        return;
    turn->size = answer_of(turn->query, turn->length, own, 0, turn->answer);
    put(turn, 0, turn->size);
}

/* Connections ------------------------------------------------------------------------------------------ */

static void take_in(void)
{
    int yes = 1, taken = accept(listener, NULL, NULL);
    if (taken < 0)
        return;
    if (count == MOST) {
        close(taken);
        return;
    }
    setsockopt(taken, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    client[count++] = taken;
}

static void drop(int which)
{
    close(client[which]);
    memmove(client + which, client + which + 1, (size_t)(--count - which) * sizeof *client);
}

/* Serve one request; 0 when the connection is gone. */
static int serve(int which)
{
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
    Turn turn = {.socket = client[which], .query = query, .stays = 1};
    modbus_set_socket(context, client[which]);
    turn.length = modbus_receive(context, query);
    if (turn.length < 0)
        turn.stays = 0;
    else if (turn.length > 0) {
        cells[REQUESTS]++;
        answer_request(&turn);
    }
    if (!turn.stays)
        drop(which);
    return turn.stays;
}

static int waits(int socket)
{
    struct pollfd one = {socket, POLLIN, 0};
    return poll(&one, 1, 0) > 0;
}

static void listen_again(void)
{
    if (listener >= 0)
        return;
    listener = modbus_tcp_listen(context, BACKLOG);
    if (listener < 0)
        fail("listen");
    fcntl(listener, F_SETFL, O_NONBLOCK);
}

static void stall(void)
{
    cells[MET]++;
    pause_ms(cells[VALUE]);
    cells[FAULT] = 0;
    while (waits(listener))
        take_in();
    for (int which = count - 1; which >= 0; which--)
        while (waits(client[which]) && serve(which))
            continue;
}

/* Nobody is there; then somebody is who knows none of the connections. */
static void restart(void)
{
    struct linger now_and_hard = {1, 0};
    cells[MET]++;
    while (is("restart"))
        pause_ms(LOOK);
    while (waits(listener))
        take_in();
    while (count) {
        setsockopt(client[0], SOL_SOCKET, SO_LINGER, &now_and_hard, sizeof now_and_hard);
        drop(0);
    }
}

static void refuse(void)
{
    if (listener >= 0) {
        cells[MET]++;
        close(listener);
        listener = -1;
    }
    while (count)
        drop(0);
    pause_ms(LOOK);
}

/* One connection; those that wait are in the kernel's queue. */
static void one(void)
{
    struct pollfd next;
    while (count > 1)
        drop(1);
    next = (struct pollfd){count ? client[0] : listener, POLLIN, 0};
    if (poll(&next, 1, LOOK) <= 0)
        return;
    if (!count)
        take_in();
    else if (!serve(0))
        pause_ms(cells[VALUE]);
}

/* One request of each connection that has one. */
static void all(void)
{
    struct pollfd ready[MOST + 1];
    int known = count;
    ready[0] = (struct pollfd){listener, POLLIN, 0};
    for (int i = 0; i < known; i++)
        ready[i + 1] = (struct pollfd){client[i], POLLIN, 0};
    if (poll(ready, (nfds_t)known + 1, LOOK) <= 0)
        return;
    for (int i = known - 1; i >= 0; i--) /* from the end, since one that is gone is taken out */
        if (ready[i + 1].revents)
            serve(i);
    if (ready[0].revents)
        take_in();
}

/* A free port, kept by a socket that never listens: nobody else gets it while the box refuses connections. */
static int keep_port(void)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    int yes = 1, kept = socket(AF_INET, SOCK_STREAM, 0);
    if (kept < 0 || setsockopt(kept, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
        bind(kept, (struct sockaddr *)&address, size) != 0 ||
        getsockname(kept, (struct sockaddr *)&address, &size) != 0)
        fail("no port");
    return ntohs(address.sin_port);
}

int main(int words, char **word)
{
    int file, port;
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* never outlive the campaign */
    file = words == 2 ? open(word[1], O_RDWR) : -1;
    if (file < 0)
        fail("no FILE");
    cells = mmap(NULL, CELLS * sizeof *cells, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (cells == MAP_FAILED)
        fail(word[1]);
    own = modbus_mapping_new(COILS, BITS, WORDS, INPUTS + 1);
    other = modbus_mapping_new(COILS, BITS, WORDS, INPUTS + 1);
    port = keep_port();
    context = modbus_new_tcp("127.0.0.1", port);
    if (context == NULL || own == NULL || other == NULL)
        fail("libmodbus");
    modbus_set_indication_timeout(context, 0, 100000); /* a request that was cut keeps nobody waiting */
    fill(own, 0);
    fill(other, 500);
    note();
    listen_again();
    cells[PORT] = port;
    for (;;) {
        if (is("refuse")) {
            refuse();
            continue;
        }
        listen_again();
        if (is("stall"))
            stall();
        else if (is("restart"))
            restart();
        else if (is("one"))
            one();
        else
            all();
    }
}
