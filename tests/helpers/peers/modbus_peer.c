/* A Modbus device made with libmodbus, for the tests of umo's driver: an independent counterpart.
 *
 *     modbus_peer [PORT | rtu | quiet | quiet-rtu] [N:FAULT[=VALUE] ...]
 *
 * Logs the masks of function 22, and of a write of two registers also "floats ABCD CDAB BADC DCBA", as libmodbus reads
 * them in each order of their bytes. Serves a map of known values: on TCP at 127.0.0.1 (a free port without PORT, or 0), or with `rtu` on a pseudo-terminal
 * of its own, as the units 1 to 3 of a serial line. Says "port N", or "port /dev/pts/N", then logs each request, before
 * it is answered, as "request FUNCTION ADDRESS COUNT [VALUES...]"; on a serial line "request UNIT:FUNCTION ...". The
 * quiet ones log nothing. Units share one map. The N-th request (from 1; 0 is every one) meets its fault:
 *     close        the connection is closed in place of an answer
 *     hangup       answered, then the connection is closed ("closed" is logged)
 *     exit         the device is gone: no answer, no connection, nobody listens
 *     silent       never answered
 *     late=MS      answered after MS milliseconds
 *     exception=N  answered by exception N
 *     truncate=N   the first N bytes of the answer, then the connection is closed
 *     fewer        a well-formed answer with one register, or eight bits, less than was asked for
 *     echo=N       the N-th byte of the answer is changed (8: the address confirmed, 9: its low byte, ...)
 *     function=N   a well-formed answer to another function
 *     bytes=N      a byte count of N with the data as it is
 *     odd          one byte of data more than was asked for, in the byte count too
 *     tail         one byte more behind the data, in the frame's length only
 *     confirm=N    the value, or the number of cells, that a write's answer confirms
 *     unit=N       answered by unit N only
 *     transaction=N  answered under a transaction's number N higher (below 0: lower) only, with other values
 *     stale        first the answer of another transaction, with other values, then the right one
 *     unasked      the right answer twice ("twice" is logged after the second)
 *     split=MS     the answer in two pieces, MS milliseconds apart
 *     trickle=MS   one byte of an answer to somebody else, every MS milliseconds, until the client leaves
 *     garbage      bytes that are not Modbus, then the connection is closed
 *     crc          on a serial line: the check sum is wrong
 *     before=N     on a serial line: N bytes of noise, then the answer
 *     refuses=N    a register that is written takes N
 * On a serial line nothing is closed: what closes a connection is silence there.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#define BITS 4500
#define REGISTERS 500
#define UNITS 3
#define LONGEST 300
#define FLOATS 480 /* input registers with one float in four orders of its bytes: ABCD, CDAB, BADC, DCBA */
#define FLOAT 238.7f

static int header = 7; /* of TCP: transaction, protocol, length, unit; of a serial line: unit */
static int trailer;    /* of a serial line: the check sum */
static int quiet;
static modbus_t *context;
static modbus_mapping_t *map;
static long requests;
static int faults;
static char **fault;

static void pause_ms(int ms) { usleep((useconds_t)ms * 1000); }

static int word(const uint8_t *bytes) { return bytes[0] << 8 | bytes[1]; }

static void fill(void)
{
    map = modbus_mapping_new(BITS, BITS, REGISTERS, REGISTERS);
    for (int i = 0; i < BITS; i++) {
        map->tab_bits[i] = i % 3 == 0;
        map->tab_input_bits[i] = i % 7 < 3;
    }
    for (int i = 0; i < REGISTERS; i++) {
        map->tab_registers[i] = (uint16_t)(i * 40503);
        map->tab_input_registers[i] = (uint16_t)(i * 25717 + 32768);
    }
    modbus_set_float_abcd(FLOAT, map->tab_input_registers + FLOATS);
    modbus_set_float_cdab(FLOAT, map->tab_input_registers + FLOATS + 2);
    modbus_set_float_badc(FLOAT, map->tab_input_registers + FLOATS + 4);
    modbus_set_float_dcba(FLOAT, map->tab_input_registers + FLOATS + 6);
}

/* The two registers of a write as a float, in each order of its bytes. */
static void log_floats(const uint8_t *bytes)
{
    uint16_t pair[2] = {(uint16_t)word(bytes), (uint16_t)word(bytes + 2)};
    printf("floats %.9g %.9g %.9g %.9g\n", modbus_get_float_abcd(pair), modbus_get_float_cdab(pair),
           modbus_get_float_badc(pair), modbus_get_float_dcba(pair));
}

/* The fault of this request: its name and value, or NULL. */
static const char *meets(int *value)
{
    static char name[32];
    for (int i = 0; i < faults; i++) {
        long n;
        *value = 0;
        if (sscanf(fault[i], "%ld:%31[a-z]=%d", &n, name, value) >= 2 && (n == requests || n == 0))
            return name;
    }
    return NULL;
}

static void log_request(const uint8_t *query)
{
    int function = query[header], count = 1;
    const uint8_t *body = query + header + 1;
    if (quiet)
        return;
    printf("request ");
    if (trailer)
        printf("%d:", query[0]);
    printf("%d %d", function, word(body));
    if (function == 5 || function == 6) {
        printf(" 1 %d", function == 5 ? word(body + 2) != 0 : word(body + 2));
    } else if (function == 22) {
        printf(" %d %d", word(body + 2), word(body + 4));
    } else {
        count = word(body + 2);
        printf(" %d", count);
        for (int i = 0; i < count && function == 15; i++)
            printf(" %d", body[5 + i / 8] >> i % 8 & 1);
        for (int i = 0; i < count && function == 16; i++)
            printf(" %d", word(body + 5 + 2 * i));
        for (int i = 0; function == 23 && i < word(body + 6); i++)
            printf(" %d", word(body + 9 + 2 * i));
    }
    printf("\n");
    if (function == 16 && count == 2)
        log_floats(body + 5);
    fflush(stdout);
}

/* What libmodbus answers, caught in place of being sent, so that it can be spoiled. */
static int answer_of(const uint8_t *query, int length, int exception, uint8_t *answer)
{
    int pair[2], own = modbus_get_socket(context), size;
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, pair) != 0)
        exit(2);
    modbus_set_socket(context, pair[0]);
    if (exception)
        modbus_reply_exception(context, query, (unsigned)exception);
    else
        modbus_reply(context, query, length, map);
    size = (int)recv(pair[1], answer, LONGEST - 1, 0);
    modbus_set_socket(context, own);
    close(pair[0]);
    close(pair[1]);
    return size;
}

static int put(int client, const uint8_t *bytes, int size)
{
    if (trailer)
        return (int)write(client, bytes, (size_t)size);
    return (int)send(client, bytes, (size_t)size, MSG_NOSIGNAL);
}

/* The check sum of a serial line, after the answer was changed. */
static void seal(uint8_t *answer, int size)
{
    unsigned sum = 0xffff;
    for (int i = 0; i < size - trailer; i++) {
        sum ^= answer[i];
        for (int bit = 0; bit < 8; bit++)
            sum = sum & 1 ? sum >> 1 ^ 0xa001 : sum >> 1;
    }
    if (trailer) {
        answer[size - 2] = (uint8_t)sum;
        answer[size - 1] = (uint8_t)(sum >> 8);
    }
}

static void shorten(uint8_t *answer, int *size)
{
    int less = answer[header] <= 2 ? 1 : 2;
    *size -= less;
    if (!trailer)
        answer[5] = (uint8_t)(answer[5] - less);
    answer[header + 1] = (uint8_t)(answer[header + 1] - less);
}

/* One byte more, in the frame's length too. */
static void lengthen(uint8_t *answer, int *size)
{
    if (!trailer)
        answer[5]++;
    answer[*size - trailer] = 0x55;
    ++*size;
}

static void other_transaction(const uint8_t *answer, int size, int client, int higher)
{
    uint8_t other[LONGEST];
    memcpy(other, answer, (size_t)size);
    other[1] = (uint8_t)(other[1] + higher);
    memset(other + header + 2, 0x55, (size_t)(size - header - 2 - trailer));
    put(client, other, size);
}

static void trickle(int client, int ms)
{
    /* The header of 254 bytes to come, for a transaction that nobody began. */
    static const uint8_t begin[] = {0xff, 0xfe, 0, 0, 0, 0xfe, 1};
    for (int i = 0; put(client, i < 7 ? begin + i : begin + 2, 1) == 1; i++)
        pause_ms(ms);
}

/* An answer of the right length to the right request, but for one thing. */
static void spoil(const char *name, int value, uint8_t *answer, int *size)
{
    if (strcmp(name, "fewer") == 0)
        shorten(answer, size);
    if (strcmp(name, "echo") == 0)
        answer[value] ^= 0x01;
    if (strcmp(name, "function") == 0)
        answer[header] = (uint8_t)value;
    if (strcmp(name, "unit") == 0)
        answer[header - 1] = (uint8_t)value;
    if (strcmp(name, "bytes") == 0)
        answer[header + 1] = (uint8_t)value;
    if (strcmp(name, "odd") == 0)
        answer[header + 1]++;
    if (strcmp(name, "odd") == 0 || strcmp(name, "tail") == 0)
        lengthen(answer, size);
    if (strcmp(name, "confirm") == 0) {
        answer[header + 3] = (uint8_t)(value >> 8);
        answer[header + 4] = (uint8_t)value;
    }
    seal(answer, *size);
    if (strcmp(name, "crc") == 0)
        answer[*size - 1] ^= 0x40;
}

static void noise(int client, int count)
{
    static const uint8_t byte = 0xa5;
    for (int i = 0; i < count; i++)
        put(client, &byte, 1);
}

/* The answer of a device that has written another value than it was sent: to be read back. */
static int taken_otherwise(const uint8_t *query, int length, int value, uint8_t *answer)
{
    uint8_t other[LONGEST];
    memcpy(other, query, (size_t)length);
    if (query[header] == 23) {
        other[header + 10] = (uint8_t)(value >> 8);
        other[header + 11] = (uint8_t)value;
    }
    return answer_of(other, length, 0, answer);
}

/* Answer one request; 0 when the connection is to be closed. */
static int serve(int client, const uint8_t *query, int length, int listener)
{
    uint8_t answer[LONGEST];
    int value, size;
    const char *name = meets(&value);
    if (name == NULL)
        name = "";
    if (strcmp(name, "close") == 0)
        return 0;
    if (strcmp(name, "exit") == 0) {
        close(listener);
        close(client);
        exit(0);
    }
    if (strcmp(name, "silent") == 0)
        return 1;
    if (strcmp(name, "trickle") == 0)
        return trickle(client, value), 0;
    if (strcmp(name, "garbage") == 0)
        return put(client, (const uint8_t *)"HTTP/1.0 400 Bad Request\r\n\r\n", 28), 0;
    size = answer_of(query, length, strcmp(name, "exception") == 0 ? value : 0, answer);
    if (strcmp(name, "refuses") == 0)
        size = taken_otherwise(query, length, value, answer);
    if (strcmp(name, "truncate") == 0)
        return put(client, answer, value), 0;
    if (strcmp(name, "transaction") == 0)
        return other_transaction(answer, size, client, value), 1;
    if (strcmp(name, "late") == 0)
        pause_ms(value);
    if (strcmp(name, "before") == 0)
        noise(client, value);
    spoil(name, value, answer, &size);
    if (strcmp(name, "stale") == 0)
        other_transaction(answer, size, client, -1);
    if (strcmp(name, "split") == 0) {
        put(client, answer, 5);
        pause_ms(value);
        return put(client, answer + 5, size - 5), 1;
    }
    put(client, answer, size);
    if (strcmp(name, "unasked") == 0) {
        put(client, answer, size);
        printf("twice\n");
        fflush(stdout);
    }
    return strcmp(name, "hangup") != 0;
}

static void turn(int client, int listener, fd_set *known)
{
    uint8_t query[LONGEST];
    int length, stays, value;
    const char *name;
    modbus_set_socket(context, client);
    length = modbus_receive(context, query);
    if (length == 0)
        return;
    stays = length > 0;
    if (stays) {
        requests++;
        log_request(query);
        stays = serve(client, query, length, listener);
    }
    if (!stays) {
        name = meets(&value);
        close(client);
        FD_CLR(client, known);
        if (length > 0 && name != NULL && strcmp(name, "hangup") == 0) {
            printf("closed\n");
            fflush(stdout);
        }
    }
}

/* How long a request on a serial line is, as far as it is known; 0 while it is not. */
static int length_of(const uint8_t *query, int size)
{
    int function = size > 1 ? query[1] : 0;
    if (size < 2)
        return 0;
    if (function == 15 || function == 16)
        return size > 6 ? 9 + query[6] : 0;
    if (function == 23)
        return size > 10 ? 13 + query[10] : 0;
    return 8;
}

/* The request as libmodbus takes it for this unit, which checks the sum; 0 if it is nobody's. */
static int checked(uint8_t *query, int size)
{
    int pair[2], length;
    if (query[0] < 1 || query[0] > UNITS || socketpair(AF_UNIX, SOCK_STREAM, 0, pair) != 0)
        return 0;
    modbus_set_slave(context, query[0]);
    modbus_set_socket(context, pair[0]);
    if (write(pair[1], query, (size_t)size) != size)
        exit(2);
    length = modbus_receive(context, query);
    close(pair[0]);
    close(pair[1]);
    return length > 0 ? length : 0;
}

/* The units of a serial line: the master's side of a pseudo-terminal, whose other side the client opens. */
static int serve_line(void)
{
    uint8_t query[2 * LONGEST], request[LONGEST];
    struct termios raw;
    int master = posix_openpt(O_RDWR | O_NOCTTY), kept, size = 0, length, got;
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0)
        return 1;
    kept = open(ptsname(master), O_RDWR | O_NOCTTY); /* or the master fails while no client is there */
    if (kept < 0 || tcgetattr(kept, &raw) != 0)
        return 1;
    cfmakeraw(&raw);
    tcsetattr(kept, TCSANOW, &raw);
    context = modbus_new_rtu(ptsname(master), 19200, 'E', 8, 1);
    fill();
    printf("port %s\n", ptsname(master));
    fflush(stdout);
    for (;;) {
        got = (int)read(master, query + size, sizeof query - (size_t)size);
        if (got <= 0)
            return 1;
        size += got;
        /* several at once are those of a client that did not wait: a device tells them apart by the silence between */
        while ((length = length_of(query, size)) > 0 && size >= length) {
            memcpy(request, query, (size_t)length);
            size -= length;
            memmove(query, query + length, (size_t)size);
            if ((length = checked(request, length)) > 0) {
                requests++;
                log_request(request);
                serve(master, request, length, -1);
            }
        }
        if (size > LONGEST)
            size = 0;
    }
}

static int accept_one(int listener)
{
    int yes = 1, client = accept(listener, NULL, NULL);
    if (client >= 0)
        setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    return client;
}

int main(int count, char **arguments)
{
    struct sockaddr_in address;
    socklen_t size = sizeof address;
    fd_set known, ready;
    int listener, client;
    signal(SIGPIPE, SIG_IGN);
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* never outlive the tests */
    fault = arguments + 2;
    faults = count - 2;
    quiet = count > 1 && strncmp(arguments[1], "quiet", 5) == 0;
    if (count > 1 && strstr(arguments[1], "rtu") != NULL) {
        header = 1;
        trailer = 2;
        return serve_line();
    }
    context = modbus_new_tcp("127.0.0.1", count > 1 ? atoi(arguments[1]) : 0);
    listener = context ? modbus_tcp_listen(context, 4) : -1;
    if (listener < 0 || getsockname(listener, (struct sockaddr *)&address, &size) != 0) {
        fprintf(stderr, "modbus_peer: %s\n", modbus_strerror(errno));
        return 1;
    }
    fill();
    printf("port %d\n", ntohs(address.sin_port));
    fflush(stdout);
    FD_ZERO(&known);
    FD_SET(listener, &known);
    for (;;) {
        ready = known;
        if (select(FD_SETSIZE, &ready, NULL, NULL, NULL) < 0)
            return 1;
        for (int fd = 0; fd < FD_SETSIZE; fd++) {
            if (!FD_ISSET(fd, &ready))
                continue;
            if (fd != listener)
                turn(fd, listener, &known);
            else if ((client = accept_one(listener)) >= 0)
                FD_SET(client, &known);
        }
    }
}
