/* The quickest device that speaks in lines, for the bench: one client after the other on a free port of 127.0.0.1, which
 * is the first line of the output. A line of queries, joined by ";", is answered by as many numbers; any other by OK;
 * COUNT? by the number of lines before it. Ends when standard input is closed.
 */
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

static char answer[65536];
static long lines;

static size_t answered(const char *line) {
    size_t n = 0;
    if (!strcmp(line, "COUNT?"))
        return snprintf(answer, sizeof answer, "%ld\n", lines);
    lines++;
    if (!strchr(line, '?'))
        return snprintf(answer, sizeof answer, "OK\n");
    for (const char *at = line; (at = strchr(at, '?')); at++)
        n += snprintf(answer + n, sizeof answer - n, "1.234;");
    answer[n - 1] = '\n';
    return n;
}

static void serve(int client) {
    static char data[65536];
    size_t length = 0;
    ssize_t n;
    while (length < sizeof data - 1 && (n = read(client, data + length, sizeof data - 1 - length)) > 0) {
        length += n;
        for (char *end; (end = memchr(data, '\n', length)); length -= end + 1 - data, memmove(data, end + 1, length)) {
            *end = 0;
            size_t size = answered(data);
            if (write(client, answer, size) != (ssize_t)size)
                return;
        }
    }
}

int main(void) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    int one = 1, listener = socket(AF_INET, SOCK_STREAM, 0);
    if (bind(listener, (struct sockaddr *)&address, size) || listen(listener, 4) ||
        getsockname(listener, (struct sockaddr *)&address, &size))
        return perror("text_bench"), 1;
    printf("port %d\n", ntohs(address.sin_port));
    fflush(stdout);
    struct pollfd waits[] = {{.fd = listener, .events = POLLIN}, {.fd = 0, .events = POLLIN}};
    while (poll(waits, 2, -1) >= 0 && !waits[1].revents) {
        int client = accept(listener, NULL, NULL);
        setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
        serve(client);
        close(client);
    }
    return 0;
}
