/* link_host.c: the line and the tick of a controller on this computer. UMO_LINK is the port of 127.0.0.1 where it waits
 * for its host (default 5327; 0: any, told on standard output), or a device file, such as /dev/ttyUSB0. Ctrl-C and
 * SIGTERM end the program, with its outputs at their defaults. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
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

enum { ROOM = 2 * LINK_LONGEST + 16 };
static int listening = -1, line = -1;
static uint8_t in[512], out[ROOM];
static ssize_t got, taken;
static size_t length;
static struct timespec next;
static volatile sig_atomic_t ends;
static const long PERIOD = (long)(MACHINE_PERIOD * 1e9 + 0.5);

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
    const struct sigaction ending = {.sa_handler = end};
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

/* A new host takes the place of the one before. */
static void accept_host(void)
{
    int yes = 1, found = listening < 0 ? -1 : accept4(listening, NULL, NULL, SOCK_NONBLOCK);
    if (found < 0)
        return;
    if (line >= 0)
        (void)close(line);
    line = found;
    (void)setsockopt(line, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
}

int link_get(void)
{
    if (taken == got) {
        accept_host();
        got = line < 0 ? 0 : read(line, in, sizeof in);
        taken = 0;
        if (got <= 0) {
            got = 0;
            return -1;
        }
    }
    return in[taken++];
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
    while (!ends && clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL) == EINTR)
        continue;
    if (ends)
        return -1;
    for (add_period(); passed(); add_period())
        ticks++;
    return ticks;
}
