/* A program for a microcontroller, beside the monitor of a sequence of the events a, b and c:

       rvaft emit trees/gates/sand.rvaft --to c --semantics scattered -o monitor.c
       python -m ziglang cc -std=c99 -Os -target thumb-freestanding-eabi -mcpu=cortex_m3 -ffreestanding
           -DRVAFT_JSON=0 -DRVAFT_CAPACITY=32 -c application.c

   It needs memcpy, memmove, memset, memcmp and strlen. A comment in monitor.c lists the fields of an event. */

#include "monitor.c"

static rvaft_monitor monitor;

void start(void) { rvaft_init(&monitor, 1); }

int on_event(const char *name) {
    rvaft_event event = {0}; /* fields that are not set are absent */
    event.field[0] = rvaft_text(name);
    return rvaft_step(&monitor, &event);
}
