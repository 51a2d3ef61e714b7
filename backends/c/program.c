#if RVAFT_JSON

/* Read a line of a log and step: a verdict or an error. */
RVAFT_API int rvaft_line(rvaft_monitor *m, rvaft_reader *r, const char *text, size_t size) {
    rvaft_event e;
    int error = rvaft_read(r, text, size, &e);
    return error != 0 ? error : rvaft_step(m, &e);
}

RVAFT_API size_t rvaft_size(void) { return sizeof(rvaft_monitor); }

RVAFT_API size_t rvaft_reader_size(void) { return sizeof(rvaft_reader); }

#if RVAFT_PLACES || RVAFT_MAIN

static int is_blank(const char *text, size_t size) {
    size_t at;
    for (at = 0; at < size; at++) {
        if (text[at] != ' ' && text[at] != '\t' && text[at] != '\r' && text[at] != '\n') {
            return 0;
        }
    }
    return 1;
}

#endif

#if RVAFT_PLACES

#if RVAFT_COUNTED

/* Counts of a log: of groups of events that pass the same tests, have values of the same types, and
   the same texts that tell event types apart; and of keys. */

#define FIRST_PLACES 21U
#define GROUPS 4096U
#define LONGEST_TEXT 204U
#define SIGNATURE (RVAFT_TESTS + RVAFT_FIELDS + 1U + (LONGEST_TEXT + 4U) * RVAFT_TEXTS_APART)

typedef struct event_group {
    uint64_t total;
    uint32_t hash;
    uint32_t next; /* of the bucket: a number, plus 1 */
    uint32_t size;
    uint8_t signature[SIGNATURE];
    place first[FIRST_PLACES];
} event_group;

typedef struct key_count {
    uint64_t total;
    uint64_t birth; /* of the key, whose place may have been that of another one */
    int64_t latest;
    int has_latest;
    place first;
} key_count;

typedef struct event_counts {
    const char *declined; /* why the events must be looked at one by one, or NULL */
    uint32_t groups;
    uint32_t head[GROUPS];
    event_group item[GROUPS];
    rvaft_value last; /* the last number in the field of times, where a tree declares none */
    key_count clock;  /* the greatest time, where no event is late */
    key_count keyless;
#if RVAFT_KEYED
    key_count key[RVAFT_KEYS];
#endif
} event_counts;

static uint32_t signature_of(int *error, const rvaft_event *e, uint8_t *made) {
    uint32_t size = RVAFT_TESTS, i;
    count_tests(error, e, made);
    for (i = 0; i < RVAFT_FIELDS; i++) {
        made[size++] = (uint8_t)e->field[i].tag;
    }
    made[size++] = (uint8_t)(e->has_time != 0);
    for (i = 0; i < RVAFT_TEXTS_APART; i++) {
        const rvaft_value *v = &e->field[texts_apart[i]];
        if (v->tag == RVAFT_TEXT) {
            uint32_t some = v->size < LONGEST_TEXT ? v->size : LONGEST_TEXT;
            memcpy(made + size, &some, sizeof some);
            memcpy(made + size + sizeof some, v->text, some);
            size += (uint32_t)sizeof some + some;
        }
    }
    return size;
}

static void count_group(event_counts *c, uint64_t seed, const rvaft_event *e) {
    uint8_t made[SIGNATURE];
    int error = 0;
    uint32_t size = signature_of(&error, e, made), hash = hash_bytes(seed, (const char *)made, size), i;
    event_group *g;
    if (error != 0) {
        c->declined = "a number of more than 64 bits";
        return;
    }
    for (i = c->head[hash % GROUPS]; i != 0; i = c->item[i - 1].next) {
        g = &c->item[i - 1];
        if (g->hash == hash && g->size == size && memcmp(g->signature, made, size) == 0) {
            break;
        }
    }
    if (i == 0) {
        if (c->groups >= GROUPS) {
            c->declined = "too many kinds of events";
            return;
        }
        g = &c->item[c->groups];
        g->hash = hash;
        g->size = size;
        memcpy(g->signature, made, size);
        g->next = c->head[hash % GROUPS];
        c->groups++;
        c->head[hash % GROUPS] = c->groups;
    }
    if (g->total < FIRST_PLACES) {
        g->first[g->total] = e->at;
    }
    g->total++;
}

/* Note the time of an event, and whether it goes back by more than events may be late. */
static void count_time(event_counts *c, key_count *k, const rvaft_event *e) {
#if RVAFT_TIMED
    k = RVAFT_LATE < 0 ? &c->clock : k;
    if (!e->has_time) {
        return;
    }
    if (k->has_latest && e->time < k->latest) {
        if (RVAFT_LATE < 0 || (uint64_t)k->latest - (uint64_t)e->time > (uint64_t)RVAFT_LATE) {
            c->declined = "the time of an event goes back";
        }
        return;
    }
    k->latest = e->time;
    k->has_latest = 1;
#else
    const rvaft_value *v = &e->field[RVAFT_CLOCK];
    (void)k;
    if (v->tag == RVAFT_ABSENT) {
        return;
    }
    if ((v->tag != RVAFT_INTEGER && v->tag != RVAFT_REAL) ||
        (c->last.tag != RVAFT_ABSENT && compare_numbers(v, &c->last) < 0)) {
        c->declined = "the time of an event goes back, or is no number";
        return;
    }
    c->last = plain(v->tag);
    c->last.integer = v->integer;
    c->last.real = v->real;
#endif
}

static void count_event(event_counts *c, const rvaft_monitor *m, const rvaft_reader *r, const rvaft_event *e) {
    key_count *k = &c->keyless;
    if (r->odd) {
        c->declined = "a number is not finite";
        return;
    }
#if RVAFT_KEYED
    if (m->key < RVAFT_KEYS) {
        k = &c->key[m->key];
        if (k->birth != m->keys.birth[m->key]) {
            memset(k, 0, sizeof *k);
            k->birth = m->keys.birth[m->key];
        }
    }
#endif
    count_group(c, m->seed, e);
    if (k != &c->keyless || !RVAFT_KEYED || RVAFT_LATE < 0) {
        count_time(c, k, e);
    }
    if (k->total == 0) {
        k->first = e->at;
    }
    k->total++;
}

#endif

/* A log that a program hands over in blocks of whole lines. */
typedef struct rvaft_log {
    int32_t verdict; /* after the last event, or an error */
    uint32_t taken;  /* the number of events of the match, after a detection */
    uint64_t number; /* of the last event */
    uint64_t line;
    uint64_t offset; /* of the next line */
    const char *reason;
    place match[RVAFT_DEPTH];
    int repeat;
    rvaft_monitor monitor;
    rvaft_reader reader;
#if RVAFT_COUNTED
    event_counts counts;
#endif
} rvaft_log;

RVAFT_API size_t rvaft_log_size(void) { return sizeof(rvaft_log); }

/* Initialise a log in memory that is zero: what is not used is not written. */
RVAFT_API void rvaft_log_begin(rvaft_log *l, uint64_t seed, int repeat) {
    l->reason = "";
    l->repeat = repeat;
    init_zeros(&l->monitor, seed);
}

#if RVAFT_KEYED

/* Keep all keys, until there is no room. */
RVAFT_API void rvaft_log_keep_keys(rvaft_log *l) { l->monitor.keys.lasts = 1; }

/* Whether there was no room for a key. Writes how many keys were forgotten, how many began with an event that may
   need one of a forgotten key, and the number of the first such event. */
RVAFT_API int rvaft_log_keys_full(const rvaft_log *l, uint64_t *to) {
    to[0] = l->monitor.keys.forgotten;
    to[1] = l->monitor.keys.early;
    to[2] = l->monitor.first_early;
    return l->monitor.keys.full;
}

#endif

/* Read whole lines, up to a detection, a verdict that becomes false, or an error. Eight more bytes
   can be read behind them. Returns the number of bytes that were read, with the last line. */
RVAFT_API size_t rvaft_log_read(rvaft_log *l, const char *text, size_t size) {
    size_t at = 0;
    l->taken = 0;
    while (at < size && l->verdict >= 0) {
        const char *newline = memchr(text + at, '\n', size - at);
        size_t begin = at, start = at, stop = newline == NULL ? size : (size_t)(newline - text);
        rvaft_event e;
        at = newline == NULL ? size : stop + 1;
        l->line++;
        if (l->line == 1 && stop >= 3 && memcmp(text, "\xEF\xBB\xBF", 3) == 0) {
            start = 3;
        }
        if (!is_blank(text + start, stop - start)) {
            int verdict = rvaft_read(&l->reader, text + start, stop - start, &e);
            l->number++;
            e.at.number = l->number;
            e.at.line = l->line;
            e.at.offset = l->offset;
            if (verdict == 0) {
                if (l->repeat && l->monitor.verdict == RVAFT_TRUE) {
                    rvaft_again(&l->monitor);
                }
                verdict = rvaft_step(&l->monitor, &e);
            }
#if RVAFT_COUNTED
            if (verdict >= 0 && l->counts.declined == NULL) {
                count_event(&l->counts, &l->monitor, &l->reader, &e);
            }
#endif
            l->verdict = verdict;
            l->reason = l->reader.reason;
        }
        l->offset += at - begin;
        if (l->verdict > 0 && l->monitor.changed) {
            if (l->verdict == RVAFT_TRUE) {
                l->taken = l->monitor.match.taken;
                memcpy(l->match, l->monitor.match.events, sizeof l->match);
            }
            l->monitor.changed = 0;
            break;
        }
    }
    return at;
}

#if RVAFT_COUNTED

/* Why the counts are not those of the log, or NULL. */
RVAFT_API const char *rvaft_log_declined(const rvaft_log *l) { return l->counts.declined; }

RVAFT_API uint32_t rvaft_log_groups(const rvaft_log *l) { return l->counts.groups; }

/* The number of events of a group; writes the places of the first ones. */
RVAFT_API uint64_t rvaft_log_group(const rvaft_log *l, uint32_t number, place *to) {
    memcpy(to, l->counts.item[number].first, sizeof l->counts.item[number].first);
    return l->counts.item[number].total;
}

RVAFT_API uint32_t rvaft_log_keys(const rvaft_log *l) {
#if RVAFT_KEYED
    return l->monitor.keys.count;
#else
    (void)l;
    return 0;
#endif
}

/* The number of events of a key (0 if it is free), or behind the last key of those without one; writes the
   place of the first one. */
RVAFT_API uint64_t rvaft_log_key(const rvaft_log *l, uint32_t number, place *to) {
    const key_count *k = &l->counts.keyless;
#if RVAFT_KEYED
    if (number < l->monitor.keys.count && number < RVAFT_KEYS) {
        k = &l->counts.key[number];
        if (l->monitor.keys.birth[number] != k->birth) {
            return 0;
        }
    }
#endif
    (void)number;
    *to = k->first;
    return k->total;
}

#endif

#endif

#endif

#if RVAFT_JSON && RVAFT_MAIN

/* A program that monitors JSON Lines: it writes a JSON object for each event, or for each detection.
   It exits with 1 if a trace detects, 0 if none does, 2 on malformed input or wrong use, and 3 where
   it has no verdict (a full array, or a number of more than 64 bits). */

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#ifndef RVAFT_LINE
#define RVAFT_LINE 67108864U /* the longest line, 64 MiB */
#endif
#define CHUNK 262144U
#define OUTPUT 65536U

static rvaft_monitor the_monitor;
static int begun; /* whether the monitor has read a trace */
static rvaft_reader the_reader;
static char input[RVAFT_LINE + 2U * CHUNK + 16U];
static char output[OUTPUT];
static size_t written;

typedef struct options {
    int repeat;
    int detections;
    int several;
    int strict;
    int complete;
} options;

static int flush_output(void) {
    size_t size = written;
    written = 0;
    return fwrite(output, 1, size, stdout) == size && fflush(stdout) == 0;
}

static int write_bytes(const char *text, size_t size) {
    if (size > OUTPUT - written && !flush_output()) {
        return 0;
    }
    if (size > OUTPUT) {
        return fwrite(text, 1, size, stdout) == size;
    }
    memcpy(output + written, text, size);
    written += size;
    return 1;
}

static int write_text(const char *text) { return write_bytes(text, strlen(text)); }

static int write_number(uint64_t n) {
    char digits[20];
    size_t at = sizeof digits;
    do {
        digits[--at] = (char)('0' + n % 10);
        n /= 10;
    } while (n != 0);
    return write_bytes(digits + at, sizeof digits - at);
}

static int write_unit(uint32_t unit) {
    char escape[8];
    return snprintf(escape, sizeof escape, "\\u%04x", (unsigned int)unit) == 6 && write_text(escape);
}

/* Write the name of a trace as a JSON string in ASCII; bytes that are not UTF-8 become U+FFFD. */
static int write_name(const char *name) {
    int good = write_text("{\"trace\": \"");
    while (good && *name != '\0') {
        unsigned char first = (unsigned char)*name++;
        int more = first < 0xC2U || first > 0xF4U ? 0 : first < 0xE0U ? 1 : first < 0xF0U ? 2 : 3;
        uint32_t code = first < 0x80U ? first : (first & (0x3FU >> more));
        int wrong = first >= 0x80U && more == 0;
        for (int i = 0; i < more && !wrong; i++) {
            unsigned char next = (unsigned char)*name;
            wrong = (next & 0xC0U) != 0x80U;
            if (!wrong) {
                code = code << 6 | (next & 0x3FU);
                name++;
            }
        }
        if (wrong || (more == 2 && (code < 0x800U || (code >= 0xD800U && code < 0xE000U))) ||
            (more == 3 && (code < 0x10000U || code > 0x10FFFFU))) {
            code = 0xFFFDU;
        }
        if (code == '"' || code == '\\') {
            good = write_text("\\");
        }
        if (code >= 0x10000U) {
            good = write_unit(0xD7C0U + (code >> 10)) && write_unit(0xDC00U + (code & 0x3FFU));
        } else if (code < 0x20U || code > 0x7EU) {
            good = write_unit(code);
        } else {
            char plain = (char)code;
            good = good && write_bytes(&plain, 1);
        }
    }
    return good && write_text("\", ");
}

#define AT_THE_END UINT64_MAX

/* Write the record of an event; with `line` as it, or the end of the log, changes the verdict. */
static int write_record(const options *o, const char *name, uint64_t number, int verdict, uint64_t line,
                        uint64_t detection) {
    static const char *const ends[3] = {", \"verdict\": \"unknown\"", ", \"verdict\": \"true\"",
                                        ", \"verdict\": \"false\""};
    int good = (o->several ? write_name(name) : write_text("{")) && write_text("\"event\": ") &&
               write_number(number) && write_text(ends[verdict]);
    if (good && line != 0) {
        good = write_text(", \"line\": ");
        good = good && (line == AT_THE_END ? write_text("null, \"passed\": \"end of the log\"") : write_number(line));
        if (good && o->repeat && verdict == RVAFT_TRUE) {
            good = write_text(", \"detection\": ") && write_number(detection);
        }
#if RVAFT_PLACES
        if (good && verdict == RVAFT_TRUE) {
            uint32_t i;
            good = write_text(", \"places\": [");
            for (i = 0; good && i < the_monitor.match.taken; i++) {
                const place *at = &the_monitor.match.events[i];
                good = write_text(i == 0 ? "[" : ", [") && write_number(at->number) && write_text(", ") &&
                       write_number(at->line) && write_text(", ") && write_number(at->offset) && write_text("]");
            }
            good = good && write_text("]");
        }
#endif
    }
    return good && write_text("}\n");
}

static int failed(const char *name, uint64_t line, const char *reason, int status) {
    (void)flush_output();
    fprintf(stderr, "%s:%llu: error: %s\n", name, (unsigned long long)line, reason);
    return status;
}

static int number_error(int code, const char **reason) {
    if (code == RVAFT_FULL) {
        *reason = the_reader.reason[0] != '\0' ? "the event needs more memory than the monitor has (RVAFT_SCRATCH)"
                                               : "an array is full: build with a larger --capacity";
        return 3;
    }
    *reason = "a number or a time needs more than 64 bits, and the native monitor cannot decide";
    return 3;
}

/* Monitor one trace; returns an exit status. */
static int run(const options *o, const char *name, FILE *file, uint64_t seed) {
    size_t begin = 0, end = 0, at = 0;
    uint64_t number = 0, line = 0, detections = 0, before = 0; /* bytes before the input */
    int last = RVAFT_UNKNOWN, ended = 0, found = 0;
    rvaft_event e;
    if (begun) {
        rvaft_init(&the_monitor, seed);
    } else {
        init_zeros(&the_monitor, seed); /* zeros are not written again, so unused memory is not touched */
    }
    begun = 1;
    for (;;) {
        const char *newline = memchr(input + at, '\n', end - at);
        size_t stop;
        if (newline == NULL && !ended) {
            size_t got;
            at = end;
            if (begin != 0) { /* the buffer stays in the cache */
                memmove(input, input + begin, end - begin);
                before += begin;
                at -= begin;
                end -= begin;
                begin = 0;
            }
            if (end - begin > RVAFT_LINE) {
                return failed(name, line + 1, "the line is longer than 64 MiB", 2);
            }
            got = fread(input + end, 1, CHUNK, file);
            if (got == 0) {
                if (ferror(file)) {
                    return failed(name, line + 1, strerror(errno), 2);
                }
                ended = 1;
            }
            if (line == 0 && begin == 0 && got >= 3 && at == 0 && memcmp(input, "\xEF\xBB\xBF", 3) == 0) {
                begin = 3;
                at = 3;
            }
            end += got;
            continue;
        }
        stop = newline == NULL ? end : (size_t)(newline - input);
        if (newline == NULL && stop == begin) {
            break;
        }
        line++;
        if (stop - begin > RVAFT_LINE) {
            return failed(name, line, "the line is longer than 64 MiB", 2);
        }
        if (!is_blank(input + begin, stop - begin)) {
            int verdict;
            char kept = input[stop];
            input[stop] = '\n';
            verdict = rvaft_read(&the_reader, input + begin, stop - begin, &e);
            input[stop] = kept;
            if (verdict == RVAFT_MALFORMED) {
                char reason[128];
                (void)snprintf(reason, sizeof reason, "not JSON: %s (byte %llu of the line)", the_reader.reason,
                               (unsigned long long)the_reader.at + 1);
                return failed(name, line, reason, 2);
            }
            number++;
#if RVAFT_PLACES
            e.at.number = number;
            e.at.line = line;
            e.at.offset = before + begin;
#endif
            (void)before;
            if (verdict == 0) {
                if (o->repeat && the_monitor.verdict == RVAFT_TRUE) {
                    rvaft_again(&the_monitor);
                    last = RVAFT_UNKNOWN;
                }
                verdict = rvaft_step(&the_monitor, &e);
            }
            if (verdict < 0) {
                const char *reason;
                int status = number_error(verdict, &reason);
                return failed(name, line, reason, status);
            }
            if (verdict != last && verdict != RVAFT_UNKNOWN) {
                detections += verdict == RVAFT_TRUE;
                found |= verdict == RVAFT_TRUE;
                if ((verdict == RVAFT_TRUE || !o->detections) &&
                    !write_record(o, name, number, verdict, line, detections)) {
                    return failed(name, line, strerror(errno), 2);
                }
            } else if (!o->detections && !write_record(o, name, number, verdict, 0, 0)) {
                return failed(name, line, strerror(errno), 2);
            }
            last = verdict;
        }
        at = stop + 1;
        begin = at;
        if (newline == NULL) {
            break;
        }
        if (begin == end) {
            before += end;
            begin = 0;
            at = 0;
            end = 0;
        }
    }
#if !RVAFT_KEYED
    if (o->complete && the_monitor.error == 0 && (last == RVAFT_UNKNOWN || o->repeat)) {
        if (o->repeat && the_monitor.verdict == RVAFT_TRUE) {
            rvaft_again(&the_monitor);
        }
        if (rvaft_finish(&the_monitor) == RVAFT_TRUE) {
            found = 1;
            if (!write_record(o, name, number, RVAFT_TRUE, AT_THE_END, detections + 1)) {
                return failed(name, line, strerror(errno), 2);
            }
        }
    }
#endif
    return found;
}

static int help(void) {
    puts("usage: monitor [--repeat] [--detections] [--complete] [FILE...]\n\n"
         "Read JSON Lines from each FILE, or from standard input, and write a verdict for each event.\n"
         "--repeat restarts the monitor after each detection; --detections writes detections only.\n"
         "--complete says that each log has ended, so that what it lacks will not come.\n"
         "The exit status is 1 if a trace detects, 0 if none does, 2 on an error in the input, and 3\n"
         "if the monitor has no verdict.");
    return 0;
}

int main(int argc, char **argv) {
    options o = {0, 0, 0, 0, 0};
    int i, status = 0, files = 0, only = 0;
    uint64_t seed = (uint64_t)time(NULL) * UINT64_C(0x9E3779B97F4A7C15) ^ (uint64_t)(uintptr_t)argv;
    for (i = 1; i < argc; i++) {
        if (only || argv[i][0] != '-' || argv[i][1] == '\0') {
            argv[++files] = argv[i];
        } else if (strcmp(argv[i], "--") == 0) {
            only = 1;
        } else if (strcmp(argv[i], "--repeat") == 0) {
#if !RVAFT_REPEATS
            fputs("error: no --repeat: the tree is repeated by a variable, as this monitor cannot be\n", stderr);
            return 2;
#endif
            o.repeat = 1;
        } else if (strcmp(argv[i], "--detections") == 0) {
            o.detections = 1;
        } else if (strcmp(argv[i], "--complete") == 0) {
            o.complete = 1;
        } else if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
            return help();
        } else {
            fprintf(stderr, "error: no option %s; see --help\n", argv[i]);
            return 2;
        }
    }
    o.several = files > 1;
    for (i = files == 0 ? 0 : 1; i <= files; i++) {
        int standard = i == 0 || strcmp(argv[i], "-") == 0, one;
        const char *name = standard ? "<stdin>" : argv[i];
        FILE *file = standard ? stdin : fopen(name, "rb");
        if (file == NULL) {
            (void)flush_output();
            fprintf(stderr, "%s: error: %s\n", name, strerror(errno));
            return 2;
        }
        one = run(&o, name, file, seed);
        if (!standard) {
            (void)fclose(file);
        }
        if (one > 1) {
            return one;
        }
        status |= one;
    }
    if (!flush_output()) {
        fprintf(stderr, "<stdout>: error: %s\n", strerror(errno));
        return 2;
    }
    return status;
}

#endif
