/* record_stdout.c: the record of a program of this computer. */
#include <stdio.h>

void record_put(char c);

void record_put(char c)
{
    (void)putchar(c);
    if (c == '\n')
        (void)fflush(stdout);
}
