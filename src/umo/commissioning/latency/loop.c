/* The least that a loop of one period can do: wait for the tick, thirteen conversions, note the two times.
   loop PERIOD_NS PERIODS PRIORITY CPU EARLY_NS: pairs of int64 (ns late in waking up, ns of work) on stdout, and one
   pair more: ns of processor time and of time that the loop took.
   Priority 0 and CPU -1: as an ordinary process. It sleeps until EARLY_NS before the tick and then looks at the clock. */
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

static int64_t clock_ns(clockid_t clock) {
    struct timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static int64_t now(void) { return clock_ns(CLOCK_MONOTONIC); }

int main(int count, char **words) {
    if (count != 6) return 2;
    int64_t period = atoll(words[1]), periods = atoll(words[2]);
    int priority = atoi(words[3]), cpu = atoi(words[4]);
    int64_t busy_wait = atoll(words[5]);
    int64_t *times = calloc(2 * periods + 2, sizeof *times);
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
    int64_t began = now(), due = began + period, first = due - busy_wait;
    struct itimerspec spec = {{period / 1000000000, period % 1000000000}, {first / 1000000000, first % 1000000000}};
    timerfd_settime(timer, TFD_TIMER_ABSTIME, &spec, NULL);
    volatile double values[13];
    volatile int64_t raws[13] = {0};
    for (int64_t i = 0; i < periods;) {
        int64_t woke;
        while ((woke = now()) < due - busy_wait) {
            uint64_t expired;
            if (read(timer, &expired, sizeof expired) != sizeof expired) return 1;
        }
        while (woke < due) woke = now();
        int64_t ticks = (woke - due) / period + 1;
        for (int k = 0; k < 13; k++) values[k] = raws[k] * 0.5 + 1.0;
        times[2 * i] = woke - due;
        times[2 * i + 1] = now() - woke;
        due += ticks * period;
        i += ticks;
    }
    times[2 * periods] = clock_ns(CLOCK_THREAD_CPUTIME_ID);
    times[2 * periods + 1] = now() - began;
    fwrite(times, sizeof *times, 2 * periods + 2, stdout);
    return 0;
}
