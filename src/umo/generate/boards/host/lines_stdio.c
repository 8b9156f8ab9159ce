/* lines_stdio.c: standard input and standard output. */
#include <stdio.h>
#include <stdlib.h>

#include "lines.h"

void line_begin(void)
{
}

int line_get(void)
{
    return getchar();
}

void line_unget(int c)
{
    (void)ungetc(c, stdin);
}

void line_put(char c)
{
    (void)putchar(c);
}

void line_flush(void)
{
    (void)fflush(stdout);
}

void line_mark(bool begins)
{
    (void)begins;
}

int32_t line_spent(void)
{
    return -1;
}

void line_end(void)
{
    exit(0);
}
