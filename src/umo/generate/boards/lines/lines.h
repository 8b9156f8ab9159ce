/* lines.h: where lines of text come from and go to. */
#ifndef LINES_H
#define LINES_H

#include <stdbool.h>
#include <stdint.h>

void line_begin(void);
int line_get(void);         /* the next character; -1 at the end */
void line_unget(int c);     /* it comes again */
void line_put(char c);
void line_flush(void);
void line_mark(bool begins); /* a step begins, or has ended: for measuring */
int32_t line_spent(void);    /* the cycles of the last step */
void line_end(void);        /* there are no more lines; does not return */

#endif
