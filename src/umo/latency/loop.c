/* The least that a loop of one period can do: wait for the tick, thirteen conversions, note the two times.
   loop PERIOD_NS PERIODS PRIORITY CPU: pairs of int64 (ns late in waking up, ns of work) on stdout.
   Priority 0 and CPU -1: as an ordinary process. */
#define _GNU_SOURCE
#include <sched.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

int main(int count, char **words) {
    if (count != 5) return 2;
    int64_t period = atoll(words[1]), periods = atoll(words[2]);
    int priority = atoi(words[3]), cpu = atoi(words[4]);
    int64_t *times = calloc(2 * periods, sizeof *times);
    if (!times) return 1;
    prctl(PR_SET_PDEATHSIG, 9);
    prctl(PR_SET_TIMERSLACK, 1);
    if (priority > 0) {
        struct sched_param p = {.sched_priority = priority};
        mlockall(MCL_CURRENT | MCL_FUTURE);
        sched_setscheduler(0, SCHED_FIFO, &p);
    }
    if (cpu >= 0) {
        cpu_set_t set;
        CPU_ZERO(&set);
        CPU_SET(cpu, &set);
        sched_setaffinity(0, sizeof set, &set);
    }
    for (int64_t i = 0; i < 2 * periods; i++) times[i] = -1; /* touched before the loop */
    int timer = timerfd_create(CLOCK_MONOTONIC, 0);
    int64_t due = now() + period;
    struct itimerspec spec = {{period / 1000000000, period % 1000000000}, {due / 1000000000, due % 1000000000}};
    timerfd_settime(timer, TFD_TIMER_ABSTIME, &spec, NULL);
    volatile double values[13];
    volatile int64_t raws[13] = {0};
    for (int64_t i = 0; i < periods;) {
        uint64_t ticks;
        if (read(timer, &ticks, sizeof ticks) != sizeof ticks) return 1;
        int64_t woke = now();
        for (int k = 0; k < 13; k++) values[k] = raws[k] * 0.5 + 1.0;
        times[2 * i] = woke - due;
        times[2 * i + 1] = now() - woke;
        due += ticks * period;
        i += ticks;
    }
    fwrite(times, sizeof *times, 2 * periods, stdout);
    return 0;
}
