/* link_host.c: the line and the tick of a controller on this computer. UMO_LINK is the port of 127.0.0.1 where it waits
 * for its host (default 5327; 0: any, told on standard output), or a device file, such as /dev/ttyUSB0. Ctrl-C and
 * SIGTERM end the program, with its outputs at their defaults.
 *
 * A host is a process of the user who started this program, as the kernel tells it (/proc/net/tcp). The first one keeps
 * the line until it has gone, or was silent for longer than LINK_HOST_TIMEOUT. Others are told why, and closed.
 *
 * Nothing that another process does or leaves undone holds the loop up: what is read in a period has a limit, and
 * standard error is written only where there is room. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "io.h"
#include "umo_link.h"

enum { ROOM = 2 * LINK_LONGEST + 16, READ_ROOM = 4096, READS = 16 + ROOM / READ_ROOM };
static int listening = -1, line = -1;
static uint8_t in[READ_ROOM], out[ROOM];
static ssize_t got, taken;
static int reads; /* of the line in this period */
static size_t length;
static int32_t silent; /* periods since the host was heard */
static struct timespec next;
static volatile sig_atomic_t ends;
static const long PERIOD = (long)(MACHINE_PERIOD * 1e9 + 0.5);
static struct {
    unsigned long count; /* that were not told yet */
    uint8_t why;         /* of the last */
    time_t told;         /* s */
} refused;

static void failed(const char *what)
{
    perror(what);
    exit(2);
}

static void open_device(const char *path)
{
    struct termios modes;
    line = open(path, O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (line < 0 || tcgetattr(line, &modes))
        failed(path);
    cfmakeraw(&modes);
    cfsetspeed(&modes, B115200);
    (void)tcsetattr(line, TCSANOW, &modes);
}

static void open_port(const char *text)
{
    struct sockaddr_in place = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(text))};
    socklen_t size = sizeof place;
    int yes = 1;
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    listening = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK, 0);
    (void)setsockopt(listening, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    if (bind(listening, (struct sockaddr *)&place, size) || listen(listening, 1))
        failed("the port of the link");
    (void)getsockname(listening, (struct sockaddr *)&place, &size);
    printf("%d\n", ntohs(place.sin_port));
    (void)fflush(stdout);
}

static void end(int number)
{
    (void)number;
    ends = 1;
}

void link_begin(void)
{
    const struct sigaction ending = {.sa_handler = end}, ignored = {.sa_handler = SIG_IGN};
    (void)sigaction(SIGPIPE, &ignored, NULL); /* of a standard error that nobody has open */
    (void)sigaction(SIGINT, &ending, NULL);
    (void)sigaction(SIGTERM, &ending, NULL);
    (void)sigaction(SIGHUP, &ending, NULL);
    const char *text = getenv("UMO_LINK");
    if (text && text[0] == '/')
        open_device(text);
    else
        open_port(text ? text : "5327");
    (void)clock_gettime(CLOCK_MONOTONIC, &next);
}

/* Whether the process at the other end of a connection is one of this user: the kernel's table has its own address and
 * port, those of the other side, the state (1: it stands), and the user. */
static bool is_own(int found)
{
    struct sockaddr_in peer, own;
    socklen_t size = sizeof peer, of_own = sizeof own;
    char text[512];
    bool is = false;
    FILE *table = fopen("/proc/net/tcp", "r");
    if (!table)
        return false;
    if (getpeername(found, (struct sockaddr *)&peer, &size) || getsockname(found, (struct sockaddr *)&own, &of_own)) {
        (void)fclose(table);
        return false;
    }
    while (!is && fgets(text, sizeof text, table)) {
        unsigned from, from_port, to, to_port, state, user;
        is = sscanf(text, " %*d: %x:%x %x:%x %x %*x:%*x %*x:%*x %*x %u", &from, &from_port, &to, &to_port, &state, &user) == 6
            && from == peer.sin_addr.s_addr && from_port == ntohs(peer.sin_port) && to == own.sin_addr.s_addr
            && to_port == ntohs(own.sin_port) && state == 1 && user == getuid();
    }
    (void)fclose(table);
    return is;
}

static void refuse(int found, uint8_t why)
{
    uint8_t body[2 + UMO_CRC_BYTES] = {LINK_REFUSED, why};
    umo_frame_send(body, 2, link_put);
    (void)!send(found, out, length, MSG_NOSIGNAL);
    length = 0;
    (void)shutdown(found, SHUT_WR);
    (void)!read(found, in, sizeof in); /* what is unread could let the answer be lost; once: it may send without end */
    (void)close(found);
    refused.count++;
    refused.why = why;
}

/* A line in a second at most, and none while standard error takes nothing. */
static void tell_refused(void)
{
    struct pollfd errors = {.fd = STDERR_FILENO, .events = POLLOUT};
    struct timespec now;
    char text[100];
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    if (now.tv_sec == refused.told || poll(&errors, 1, 0) != 1 || !(errors.revents & POLLOUT))
        return;
    const char *why = refused.why == LINK_HAS_A_HOST ? "there is a host" : "a process of another user";
    int size = snprintf(text, sizeof text, "connections refused: %lu, the last: %s\n", refused.count, why);
    (void)!write(STDERR_FILENO, text, (size_t)size);
    refused.count = 0;
    refused.told = now.tv_sec;
}

/* The host that has come, if the line is free. */
static void accept_host(void)
{
    int yes = 1, found = listening < 0 ? -1 : accept4(listening, NULL, NULL, SOCK_NONBLOCK);
    if (found < 0)
        return;
    if (line >= 0 && silent <= (int32_t)LINK_HOST_TIMEOUT) {
        refuse(found, LINK_HAS_A_HOST);
    } else if (!is_own(found)) {
        refuse(found, LINK_NOT_OWN);
    } else {
        if (line >= 0)
            (void)close(line);
        line = found;
        silent = 0;
        (void)setsockopt(line, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
    }
}

/* What the line has, up to the limit of a period; a host that has closed it has gone. */
static void receive(void)
{
    taken = 0;
    got = -1;
    if (line < 0 || reads++ >= READS)
        return;
    got = read(line, in, sizeof in);
    if (got > 0)
        silent = 0;
    else if (listening >= 0 && (got == 0 || (errno != EAGAIN && errno != EINTR))) {
        (void)close(line);
        line = -1;
    }
}

int link_get(void)
{
    if (taken >= got) {
        receive();
        if (got <= 0) {
            accept_host();
            receive();
        }
    }
    return got > 0 ? in[taken++] : -1;
}

void link_put(uint8_t byte)
{
    if (length < ROOM)
        out[length++] = byte;
}

void link_end(void)
{
    if (line >= 0 && listening >= 0)
        (void)!send(line, out, length, MSG_NOSIGNAL);
    else if (line >= 0)
        (void)!write(line, out, length);
    length = 0;
}

static bool passed(void)
{
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec > next.tv_sec || (now.tv_sec == next.tv_sec && now.tv_nsec >= next.tv_nsec);
}

static void add_period(void)
{
    next.tv_nsec += PERIOD;
    while (next.tv_nsec >= 1000000000L) {
        next.tv_nsec -= 1000000000L;
        next.tv_sec++;
    }
}

int32_t io_wait(void)
{
    int32_t ticks = 1;
    reads = 0;
    if (refused.count)
        tell_refused();
    while (!ends && clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL) == EINTR)
        continue;
    if (ends)
        return -1;
    for (add_period(); passed(); add_period())
        ticks++;
    silent = silent > INT32_MAX - ticks ? INT32_MAX : silent + ticks;
    return ticks;
}
