/* Types. A value keeps strings as bytes in UTF-8. An integral double is an INTEGER, or a BIG if it
   needs more than 64 bits; a BIG has its decimal digits as text. */

#include <stddef.h>
#include <stdint.h>

#if __STDC_HOSTED__
#include <string.h>
#else /* the compiler needs these, too */
void *memcpy(void *to, const void *from, size_t size);
void *memmove(void *to, const void *from, size_t size);
void *memset(void *to, int value, size_t size);
int memcmp(const void *a, const void *b, size_t size);
size_t strlen(const char *text);
#endif

#if defined(__GNUC__)
#define RVAFT_UNUSED __attribute__((unused))
#else
#define RVAFT_UNUSED
#endif

/* The results of rvaft_step; an error is negative and is never a verdict. */
enum {
    RVAFT_UNKNOWN = 0,
    RVAFT_TRUE = 1,
    RVAFT_FALSE = 2,
    RVAFT_FULL = -1,        /* an array is full: compile with a larger RVAFT_CAPACITY */
    RVAFT_UNSUPPORTED = -2, /* a number or a time needs more than 64 bits */
    RVAFT_MALFORMED = -3    /* a line is not one JSON object */
};

enum rvaft_tag {
    RVAFT_ABSENT, /* the event has no such field */
    RVAFT_UNDEFINED,
    RVAFT_NULL,
    RVAFT_NO,
    RVAFT_YES,
    RVAFT_INTEGER,
    RVAFT_REAL,
    RVAFT_BIG,
    RVAFT_TEXT,
    RVAFT_OBJECT, /* text is a canonical form, or NULL where nothing compares the object */
    RVAFT_LIST    /* as for an object; integer is the number of items */
};

typedef struct rvaft_value {
    const char *text;
    double real;
    int64_t integer;
    uint32_t size; /* of text, in bytes */
    uint32_t tag;
} rvaft_value;

/* The place of an event in a log: its number and its line, from 1, and the offset of the line. */
typedef struct place {
    uint64_t number;
    uint64_t line;
    uint64_t offset;
} place;

/* An event: its time in nanoseconds, if it has one, and the fields that the tree reads. */
typedef struct rvaft_event {
    int64_t time;
    int has_time;
#if RVAFT_PLACES
    place at;
#endif
    rvaft_value field[RVAFT_FIELDS];
} rvaft_event;

/* A value of a partial match; texts are in the pool of the monitor. */
typedef struct cell {
    int64_t bits;
    uint32_t tag;
    uint32_t hash;
} cell;

#define NONE UINT32_MAX
#define MAX_LINKS RVAFT_LINKS

typedef struct partial {
    uint32_t next[MAX_LINKS];
    uint32_t stage;
    cell slot[RVAFT_WIDTH];
#if RVAFT_PLACES
    uint32_t taken;
    place events[RVAFT_DEPTH];
#endif
} partial;

/* Partial matches with hash tables. The first has the partial matches that are equal except for
   times that can be compared; the others have those that one move concerns. */
typedef struct bucket {
    uint32_t head;
    uint32_t epoch; /* a bucket of another epoch is empty */
} bucket;

typedef struct store {
    uint32_t count;
    uint32_t epoch;
    uint32_t mask; /* of the buckets in use: fewer stay in the cache */
    bucket buckets[MAX_LINKS][RVAFT_BUCKETS];
    partial item[RVAFT_CAPACITY];
} store;

/* Interned texts. */
typedef struct pool {
    uint32_t used;  /* bytes */
    uint32_t count; /* texts, with those that are free */
    uint32_t spare; /* the first free text */
    uint32_t mask;  /* of the buckets in use */
    uint32_t head[RVAFT_BUCKETS];
    uint32_t next[RVAFT_TEXTS];
    uint32_t start[RVAFT_TEXTS];
    uint32_t size[RVAFT_TEXTS]; /* NONE if free */
    uint32_t hash[RVAFT_TEXTS];
    uint8_t live[RVAFT_TEXTS];
    char bytes[RVAFT_TEXT_BYTES];
} pool;

typedef struct rvaft_monitor {
    uint64_t seed;
    int64_t latest; /* the greatest time so far */
    int has_latest;
    int verdict;
    int error;
    uint32_t sweep_at;
    uint32_t now; /* the store with the partial matches */
    store stores[RVAFT_STORES];
    pool texts;
    cell cells[RVAFT_FIELDS]; /* of the event */
    uint8_t known[RVAFT_FIELDS];
#if RVAFT_PLACES
    partial match; /* after a detection */
#endif
} rvaft_monitor;

typedef struct stage {
    uint32_t rank; /* a move leads to a lower rank; 0 detects */
    uint16_t slots;
    uint16_t exact; /* the first slots must be equal for one partial match to replace another */
    uint32_t move;  /* the first move */
    uint16_t moves;
    uint16_t links;
    uint32_t link;    /* the first list of slots in link_slots */
    uint32_t order;   /* in slot_order: 1 if a smaller time is better, else 0, after the exact slots */
    uint32_t expiry;  /* the first in expiries */
    uint32_t expires; /* the number of expiries */
} stage;

typedef struct move {
    uint32_t stage;
    uint32_t target;
    uint32_t pattern;
    uint32_t guard; /* 0: none */
    uint32_t load;  /* the first in loads, one for each slot of the target */
    uint32_t join;  /* the first in joins */
    uint16_t joins;
    uint16_t link;
} move;

enum { COPY, FIELD, NOW, LATEST, EARLIEST };

typedef struct load {
    uint8_t from;
    uint8_t slot;
    uint16_t field;
} load;

typedef struct join {
    uint16_t slot;
    uint16_t field;
} join;

/* A node of the fields that the tree reads: a key, or (without a name) the item of a list. */
typedef struct field_node {
    const char *name;
    uint32_t size; /* of the name, or the number of the item */
    int32_t child;
    int32_t next;
    uint8_t whole; /* whether a list or an object is compared as a whole */
} field_node;

typedef struct expiry {
    uint32_t slot;
    int64_t most;
} expiry;

/* Values. */

RVAFT_UNUSED static rvaft_value plain(uint32_t tag) {
    rvaft_value v = {NULL, 0.0, 0, 0, 0};
    v.tag = tag;
    return v;
}

RVAFT_UNUSED static rvaft_value truth(int yes) { return plain(yes ? RVAFT_YES : RVAFT_NO); }

RVAFT_UNUSED static rvaft_value integer(int64_t i) {
    rvaft_value v = plain(RVAFT_INTEGER);
    v.integer = i;
    return v;
}

RVAFT_UNUSED static rvaft_value bytes_of(uint32_t tag, const char *text, uint32_t size) {
    rvaft_value v = plain(tag);
    v.text = text;
    v.size = size;
    return v;
}

/* Set fields of an event. */
RVAFT_UNUSED static rvaft_value rvaft_text(const char *text) {
    return bytes_of(RVAFT_TEXT, text, (uint32_t)strlen(text));
}

#define TWO_63 9223372036854775808.0

/* The value of a double; with more than 64 bits it is unsupported (a BIG without digits). */
RVAFT_UNUSED static rvaft_value rvaft_real(double d) {
    rvaft_value v;
    if (!(d - d == 0.0)) {
        return plain(RVAFT_UNDEFINED);
    }
    if (d >= TWO_63 || d < -TWO_63) {
        return plain(RVAFT_BIG);
    }
    if ((double)(int64_t)d == d) {
        return integer((int64_t)d);
    }
    v = plain(RVAFT_REAL);
    v.real = d;
    return v;
}

static int is_number(const rvaft_value *v) { return v->tag >= RVAFT_INTEGER && v->tag <= RVAFT_BIG; }

static int same_bytes(const rvaft_value *a, const rvaft_value *b) {
    return a->size == b->size && (a->size == 0 || memcmp(a->text, b->text, a->size) == 0);
}

static int is_defined(const rvaft_value *v) {
    return v->tag > RVAFT_UNDEFINED && !((v->tag == RVAFT_OBJECT || v->tag == RVAFT_LIST) && v->text == NULL);
}

/* Whether two values are equal; one that is undefined equals nothing. */
RVAFT_UNUSED static int same(const rvaft_value *a, const rvaft_value *b) {
    if (a->tag != b->tag || !is_defined(a) || !is_defined(b)) {
        return 0;
    }
    if (a->tag == RVAFT_INTEGER) {
        return a->integer == b->integer;
    }
    if (a->tag == RVAFT_REAL) {
        return a->real == b->real;
    }
    return a->tag < RVAFT_INTEGER || same_bytes(a, b);
}

static int compare_bytes(const rvaft_value *a, const rvaft_value *b) {
    uint32_t common = a->size < b->size ? a->size : b->size;
    int order = common == 0 ? 0 : memcmp(a->text, b->text, common);
    return order != 0 ? order : a->size < b->size ? -1 : a->size > b->size;
}

static int sign_of_big(const rvaft_value *v) { return v->text[0] == '-' ? -1 : 1; }

/* The order of two numbers. */
static int compare_numbers(const rvaft_value *a, const rvaft_value *b) {
    if (a->tag == RVAFT_BIG && b->tag == RVAFT_BIG) {
        int sign = sign_of_big(a);
        if (sign != sign_of_big(b)) {
            return sign;
        }
        return a->size != b->size ? (a->size < b->size ? -sign : sign) : sign * compare_bytes(a, b);
    }
    if (a->tag == RVAFT_BIG) {
        return sign_of_big(a);
    }
    if (b->tag == RVAFT_BIG) {
        return -sign_of_big(b);
    }
    if (a->tag == RVAFT_INTEGER && b->tag == RVAFT_INTEGER) {
        return a->integer < b->integer ? -1 : a->integer > b->integer;
    }
    if (a->tag == RVAFT_REAL && b->tag == RVAFT_REAL) {
        return a->real < b->real ? -1 : a->real > b->real;
    }
    if (a->tag == RVAFT_REAL) {
        return -compare_numbers(b, a);
    }
    /* A double that is no integer is less than 2^53. */
    return a->integer < (int64_t)b->real || (a->integer == (int64_t)b->real && b->real > 0) ? -1 : 1;
}

/* Guards. Each operator returns UNDEFINED for operands of another type, and notes in `error` that
   a result needs more than 64 bits. */

RVAFT_UNUSED static int holds(rvaft_value v) { return v.tag == RVAFT_YES; }

static int is_truth(const rvaft_value *v) { return v->tag == RVAFT_NO || v->tag == RVAFT_YES; }

RVAFT_UNUSED static rvaft_value both(rvaft_value a, rvaft_value b) {
    return a.tag == RVAFT_NO ? a : a.tag == RVAFT_YES && is_truth(&b) ? b : plain(RVAFT_UNDEFINED);
}

RVAFT_UNUSED static rvaft_value either(rvaft_value a, rvaft_value b) {
    return a.tag == RVAFT_YES ? a : a.tag == RVAFT_NO && is_truth(&b) ? b : plain(RVAFT_UNDEFINED);
}

RVAFT_UNUSED static rvaft_value denied(rvaft_value a) {
    return is_truth(&a) ? truth(a.tag == RVAFT_NO) : plain(RVAFT_UNDEFINED);
}

RVAFT_UNUSED static rvaft_value equals(rvaft_value a, rvaft_value b) {
    return is_defined(&a) && is_defined(&b) ? truth(same(&a, &b)) : plain(RVAFT_UNDEFINED);
}

/* The order of two numbers or two texts: -1, 0 or 1, or 2 if there is none. */
static int ordered(const rvaft_value *a, const rvaft_value *b) {
    int order;
    if (is_number(a) && is_number(b)) {
        return compare_numbers(a, b);
    }
    if (a->tag != RVAFT_TEXT || b->tag != RVAFT_TEXT) {
        return 2;
    }
    order = compare_bytes(a, b);
    return order < 0 ? -1 : order > 0;
}

RVAFT_UNUSED static rvaft_value less(rvaft_value a, rvaft_value b) {
    int order = ordered(&a, &b);
    return order == 2 ? plain(RVAFT_UNDEFINED) : truth(order < 0);
}

RVAFT_UNUSED static rvaft_value at_most(rvaft_value a, rvaft_value b) {
    int order = ordered(&a, &b);
    return order == 2 ? plain(RVAFT_UNDEFINED) : truth(order <= 0);
}

static rvaft_value unsupported(int *error) {
    *error = RVAFT_UNSUPPORTED;
    return plain(RVAFT_UNDEFINED);
}

static rvaft_value result(int *error, double d) {
    rvaft_value v = rvaft_real(d);
    return v.tag == RVAFT_BIG ? unsupported(error) : v;
}

static double as_real(const rvaft_value *v) { return v->tag == RVAFT_INTEGER ? (double)v->integer : v->real; }

/* Whether a calculation has an operand that is no number (then `a` becomes UNDEFINED) or too large. */
static int unusable(int *error, rvaft_value *a, const rvaft_value *b) {
    if (!is_number(a) || !is_number(b)) {
        *a = plain(RVAFT_UNDEFINED);
        return 1;
    }
    if (a->tag == RVAFT_BIG || b->tag == RVAFT_BIG) {
        *a = unsupported(error);
        return 1;
    }
    return 0;
}

RVAFT_UNUSED static rvaft_value add(int *error, rvaft_value a, rvaft_value b) {
    if (unusable(error, &a, &b)) {
        return a;
    }
    if (a.tag != RVAFT_INTEGER || b.tag != RVAFT_INTEGER) {
        return result(error, as_real(&a) + as_real(&b));
    }
    if (b.integer >= 0 ? a.integer > INT64_MAX - b.integer : a.integer < INT64_MIN - b.integer) {
        return unsupported(error);
    }
    return integer(a.integer + b.integer);
}

RVAFT_UNUSED static rvaft_value negated(int *error, rvaft_value a) {
    if (unusable(error, &a, &a)) {
        return a;
    }
    if (a.tag == RVAFT_REAL) {
        return rvaft_real(-a.real);
    }
    return a.integer == INT64_MIN ? unsupported(error) : integer(-a.integer);
}

RVAFT_UNUSED static rvaft_value subtract(int *error, rvaft_value a, rvaft_value b) {
    if (unusable(error, &a, &b)) {
        return a;
    }
    if (a.tag != RVAFT_INTEGER || b.tag != RVAFT_INTEGER) {
        return result(error, as_real(&a) - as_real(&b));
    }
    if (b.integer >= 0 ? a.integer < INT64_MIN + b.integer : a.integer > INT64_MAX + b.integer) {
        return unsupported(error);
    }
    return integer(a.integer - b.integer);
}

static uint64_t magnitude(int64_t i) { return i < 0 ? 0U - (uint64_t)i : (uint64_t)i; }

RVAFT_UNUSED static rvaft_value multiply(int *error, rvaft_value a, rvaft_value b) {
    uint64_t left, right;
    if (unusable(error, &a, &b)) {
        return a;
    }
    if (a.tag != RVAFT_INTEGER || b.tag != RVAFT_INTEGER) {
        return result(error, as_real(&a) * as_real(&b));
    }
    left = magnitude(a.integer);
    right = magnitude(b.integer);
    if (left != 0 && right > (uint64_t)INT64_MAX / left) {
        return unsupported(error);
    }
    return integer((a.integer < 0) == (b.integer < 0) ? (int64_t)(left * right) : -(int64_t)(left * right));
}

/* The double that is nearest to the quotient of two integers. */
static double quotient(int64_t a, int64_t b) {
    uint64_t left = magnitude(a), right = magnitude(b), whole = left / right, rest = left % right;
    int sticky, shift = 0;
    double d;
    while (whole < (UINT64_C(1) << 55) && rest != 0) {
        rest *= 2;
        whole *= 2;
        shift++;
        if (rest >= right) {
            rest -= right;
            whole++;
        }
    }
    sticky = rest != 0;
    while (whole >= (UINT64_C(1) << 57)) {
        sticky |= (int)(whole & 1);
        whole /= 2;
        shift--;
    }
    d = (double)(whole * 2 | (uint64_t)(sticky != 0)) / 2;
    for (; shift > 0; shift--) {
        d /= 2;
    }
    for (; shift < 0; shift++) {
        d *= 2;
    }
    return (a < 0) == (b < 0) ? d : -d;
}

RVAFT_UNUSED static rvaft_value divide(int *error, rvaft_value a, rvaft_value b) {
    if (unusable(error, &a, &b)) {
        return a;
    }
    if (as_real(&b) == 0.0) {
        return plain(RVAFT_UNDEFINED);
    }
    if (a.tag == RVAFT_INTEGER && b.tag == RVAFT_INTEGER) {
        return result(error, quotient(a.integer, b.integer));
    }
    return result(error, as_real(&a) / as_real(&b));
}

RVAFT_UNUSED static rvaft_value absolute(int *error, rvaft_value a) {
    if (a.tag == RVAFT_REAL ? a.real >= 0 : a.tag == RVAFT_INTEGER && a.integer >= 0) {
        return a;
    }
    return negated(error, a);
}

RVAFT_UNUSED static rvaft_value lesser(rvaft_value a, rvaft_value b) {
    if (!is_number(&a) || !is_number(&b)) {
        return plain(RVAFT_UNDEFINED);
    }
    return compare_numbers(&b, &a) < 0 ? b : a;
}

RVAFT_UNUSED static rvaft_value greater(rvaft_value a, rvaft_value b) {
    if (!is_number(&a) || !is_number(&b)) {
        return plain(RVAFT_UNDEFINED);
    }
    return compare_numbers(&b, &a) > 0 ? b : a;
}

static int are_texts(const rvaft_value *a, const rvaft_value *b) {
    return a->tag == RVAFT_TEXT && b->tag == RVAFT_TEXT;
}

RVAFT_UNUSED static rvaft_value starts_with(rvaft_value a, rvaft_value b) {
    if (!are_texts(&a, &b)) {
        return plain(RVAFT_UNDEFINED);
    }
    return truth(b.size == 0 || (b.size <= a.size && memcmp(a.text, b.text, b.size) == 0));
}

RVAFT_UNUSED static rvaft_value ends_with(rvaft_value a, rvaft_value b) {
    if (!are_texts(&a, &b)) {
        return plain(RVAFT_UNDEFINED);
    }
    return truth(b.size == 0 || (b.size <= a.size && memcmp(a.text + (a.size - b.size), b.text, b.size) == 0));
}

RVAFT_UNUSED static rvaft_value contains(rvaft_value a, rvaft_value b) {
    uint32_t at;
    if (!are_texts(&a, &b)) {
        return plain(RVAFT_UNDEFINED);
    }
    if (b.size == 0) {
        return truth(1);
    }
    for (at = 0; at + b.size <= a.size; at++) {
        if (a.text[at] == b.text[0] && memcmp(a.text + at, b.text, b.size) == 0) {
            return truth(1);
        }
    }
    return truth(0);
}

static uint32_t next_character(const rvaft_value *v, uint32_t at) {
    do {
        at++;
    } while (at < v->size && ((unsigned char)v->text[at] & 0xC0U) == 0x80U);
    return at;
}

/* Whether a text matches a glob: * stands for any characters, ? for one. */
RVAFT_UNUSED static rvaft_value like(rvaft_value a, rvaft_value glob) {
    uint32_t at = 0, sign = 0, star = NONE, back = 0;
    if (!are_texts(&a, &glob)) {
        return plain(RVAFT_UNDEFINED);
    }
    while (at < a.size) {
        if (sign < glob.size && glob.text[sign] == '*') {
            star = ++sign;
            back = at;
        } else if (sign < glob.size && glob.text[sign] == '?') {
            at = next_character(&a, at);
            sign++;
        } else if (sign < glob.size && glob.text[sign] == a.text[at]) {
            at++;
            sign++;
        } else if (star != NONE) {
            back = next_character(&a, back);
            at = back;
            sign = star;
        } else {
            return truth(0);
        }
    }
    while (sign < glob.size && glob.text[sign] == '*') {
        sign++;
    }
    return truth(sign == glob.size);
}

/* Decimals: exact conversion between decimal digits and doubles. */

#define DIGITS 800

typedef struct decimal {
    int count;     /* of digits, without zeros at the end */
    int point;     /* the value is 0.ddd * 10^point */
    int truncated; /* whether digits were lost, which were not all zero */
    uint8_t digit[DIGITS + 32];
} decimal;

static void trim(decimal *d) {
    if (d->count > DIGITS) {
        int i;
        for (i = DIGITS; i < d->count; i++) {
            d->truncated |= d->digit[i] != 0;
        }
        d->count = DIGITS;
    }
    while (d->count > 0 && d->digit[d->count - 1] == 0) {
        d->count--;
    }
    if (d->count == 0) {
        d->point = 0;
    }
}

static void shift_left(decimal *d, int bits) {
    uint64_t rest = 0;
    uint8_t first[24];
    int i, more = 0;
    for (i = d->count - 1; i >= 0; i--) {
        rest += (uint64_t)d->digit[i] << bits;
        d->digit[i] = (uint8_t)(rest % 10);
        rest /= 10;
    }
    while (rest != 0 && more < 24) {
        first[more++] = (uint8_t)(rest % 10);
        rest /= 10;
    }
    memmove(d->digit + more, d->digit, (size_t)d->count);
    for (i = 0; i < more; i++) {
        d->digit[i] = first[more - 1 - i];
    }
    d->count += more;
    d->point += more;
    trim(d);
}

static void shift_right(decimal *d, int bits) {
    uint64_t rest = 0, mask = (UINT64_C(1) << bits) - 1;
    int from = 0, to = 0;
    while (rest >> bits == 0) {
        if (from >= d->count) {
            if (rest == 0) {
                d->count = 0;
                trim(d);
                return;
            }
            while (rest >> bits == 0) {
                rest *= 10;
                from++;
            }
            break;
        }
        rest = rest * 10 + d->digit[from++];
    }
    d->point -= from - 1;
    while (from < d->count) {
        uint8_t digit = (uint8_t)(rest >> bits);
        rest = (rest & mask) * 10 + d->digit[from++];
        d->digit[to++] = digit;
    }
    while (rest > 0) {
        uint8_t digit = (uint8_t)(rest >> bits);
        rest = (rest & mask) * 10;
        if (to < DIGITS) {
            d->digit[to++] = digit;
        } else if (digit != 0) {
            d->truncated = 1;
        }
    }
    d->count = to;
    trim(d);
}

static uint64_t rounded(const decimal *d) {
    uint64_t n = 0;
    int i, up = 0;
    for (i = 0; i < d->point && i < d->count; i++) {
        n = n * 10 + d->digit[i];
    }
    for (; i < d->point; i++) {
        n *= 10;
    }
    if (d->point >= 0 && d->point < d->count) {
        up = d->digit[d->point] >= 5;
        if (d->digit[d->point] == 5 && d->point + 1 == d->count) {
            up = d->truncated || (n & 1) != 0;
        }
    }
    return n + (uint64_t)up;
}

static double from_bits(uint64_t bits) {
    double d;
    memcpy(&d, &bits, sizeof d);
    return d;
}

/* The double that is nearest to a decimal; may be infinite. */
static double nearest(decimal *d) {
    static const uint8_t steps[9] = {1, 3, 6, 9, 13, 16, 19, 23, 26};
    uint64_t mantissa;
    int exponent = 0;
    if (d->count == 0 || d->point < -330) {
        return 0.0;
    }
    if (d->point > 310) {
        return from_bits(UINT64_C(0x7FF) << 52);
    }
    while (d->point > 0) {
        int bits = d->point >= 9 ? 27 : steps[d->point];
        shift_right(d, bits);
        exponent += bits;
    }
    while (d->point < 0 || (d->point == 0 && d->digit[0] < 5)) {
        int bits = -d->point >= 9 ? 27 : steps[-d->point];
        shift_left(d, bits);
        exponent -= bits;
    }
    exponent--;
    while (exponent < -1022) {
        int bits = -1022 - exponent > 27 ? 27 : -1022 - exponent;
        shift_right(d, bits);
        exponent += bits;
    }
    if (exponent > 1023) {
        return from_bits(UINT64_C(0x7FF) << 52);
    }
    shift_left(d, 53);
    mantissa = rounded(d);
    if (mantissa == UINT64_C(1) << 53) {
        mantissa /= 2;
        if (++exponent > 1023) {
            return from_bits(UINT64_C(0x7FF) << 52);
        }
    }
    if ((mantissa & UINT64_C(1) << 52) == 0) {
        exponent = -1023;
    }
    return from_bits((mantissa & ((UINT64_C(1) << 52) - 1)) | (uint64_t)(exponent + 1023) << 52);
}

/* Read a JSON number; `point` is 1 where it has a decimal point or an exponent. Returns the size
   of the number, or 0 if there is none. */
static uint32_t number_end(const char *text, uint32_t size, int *point) {
    uint32_t at = 0, from;
    *point = 0;
    if (at < size && text[at] == '-') {
        at++;
    }
    if (at >= size || text[at] < '0' || text[at] > '9') {
        return 0;
    }
    if (text[at] == '0') {
        at++;
    } else {
        while (at < size && text[at] >= '0' && text[at] <= '9') {
            at++;
        }
    }
    if (at + 1 < size && text[at] == '.' && text[at + 1] >= '0' && text[at + 1] <= '9') {
        *point = 1;
        at++;
        while (at < size && text[at] >= '0' && text[at] <= '9') {
            at++;
        }
    }
    if (at < size && (text[at] == 'e' || text[at] == 'E')) {
        from = at + 1;
        if (from < size && (text[from] == '+' || text[from] == '-')) {
            from++;
        }
        if (from < size && text[from] >= '0' && text[from] <= '9') {
            *point = 1;
            at = from;
            while (at < size && text[at] >= '0' && text[at] <= '9') {
                at++;
            }
        }
    }
    return at;
}

/* The decimal that a JSON number writes. */
static void read_decimal(const char *text, uint32_t size, decimal *d) {
    uint32_t at = text[0] == '-';
    int exponent = 0, minus = 0, dot = 0;
    d->count = 0;
    d->point = 0;
    d->truncated = 0;
    for (; at < size && text[at] != 'e' && text[at] != 'E'; at++) {
        if (text[at] == '.') {
            dot = 1;
            continue;
        }
        if (d->count == 0 && text[at] == '0') {
            d->point -= dot;
            continue;
        }
        if (d->count < DIGITS) {
            d->digit[d->count++] = (uint8_t)(text[at] - '0');
        } else {
            d->truncated |= text[at] != '0';
        }
        d->point += !dot;
    }
    if (at < size) {
        at++;
        if (text[at] == '+' || text[at] == '-') {
            minus = text[at] == '-';
            at++;
        }
        for (; at < size; at++) {
            exponent = exponent > 100000000 ? exponent : exponent * 10 + (text[at] - '0');
        }
        if (d->count != 0) {
            d->point += minus ? -exponent : exponent;
        }
    }
    trim(d);
}

/* The digits of a double with more than 64 bits; `to` has room for 320. Returns their number. */
static uint32_t digits_of(double value, char *to) {
    decimal d;
    uint64_t bits, mantissa;
    int exponent, i, most;
    uint32_t size = 0;
    memcpy(&bits, &value, sizeof bits);
    mantissa = (bits & ((UINT64_C(1) << 52) - 1)) | UINT64_C(1) << 52;
    exponent = (int)((bits >> 52) & 0x7FFU) - 1075;
    d.count = 0;
    d.truncated = 0;
    for (i = 19; i >= 0; i--) {
        d.digit[i] = (uint8_t)(mantissa % 10);
        mantissa /= 10;
    }
    for (i = 0; d.digit[i] == 0; i++) {
    }
    memmove(d.digit, d.digit + i, (size_t)(20 - i));
    d.count = 20 - i;
    d.point = d.count;
    trim(&d);
    while (exponent > 0) {
        int step = exponent > 59 ? 59 : exponent;
        shift_left(&d, step);
        exponent -= step;
    }
    if (value < 0) {
        to[size++] = '-';
    }
    most = d.point < 310 ? d.point : 310;
    for (i = 0; i < most; i++) {
        to[size++] = (char)('0' + (i < d.count ? d.digit[i] : 0));
    }
    return size;
}

/* The value of a JSON number. A BIG that a decimal point or an exponent writes has no digits:
   `digits`, if not NULL, has room for 320 of them. */
static rvaft_value read_number(const char *text, uint32_t size, int point, char *digits) {
    static const double powers[23] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                      1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    rvaft_value v;
    uint64_t n = 0;
    uint32_t at = text[0] == '-';
    double d;
    if (!point) {
        if (size - at <= 18) {
            for (; at < size; at++) {
                n = n * 10 + (uint64_t)(text[at] - '0');
            }
            v = integer(text[0] == '-' ? -(int64_t)n : (int64_t)n);
        } else {
            uint64_t limit = (uint64_t)INT64_MAX + (uint64_t)(text[0] == '-');
            v = bytes_of(RVAFT_BIG, text, size);
            if (size - at == 19) {
                for (; at < size; at++) {
                    n = n * 10 + (uint64_t)(text[at] - '0');
                }
                if (n <= limit) {
                    v = integer(text[0] == '-' ? (int64_t)(0U - n) : (int64_t)n);
                }
            }
        }
    } else {
        int scale = 0, significant = 0, dot = 0, exponent = 0, minus = 0;
        for (; at < size && text[at] != 'e' && text[at] != 'E' && significant <= 15; at++) {
            if (text[at] == '.') {
                dot = 1;
            } else {
                n = n * 10 + (uint64_t)(text[at] - '0');
                significant += n != 0;
                scale += dot;
            }
        }
        if (significant <= 15 && at < size) {
            at++;
            if (text[at] == '+' || text[at] == '-') {
                minus = text[at] == '-';
                at++;
            }
            for (; at < size; at++) {
                exponent = exponent > 100000 ? exponent : exponent * 10 + (text[at] - '0');
            }
        }
        exponent = (minus ? -exponent : exponent) - scale;
        if (significant <= 15 && exponent >= -22 && exponent <= 22) {
            d = exponent < 0 ? (double)n / powers[-exponent] : (double)n * powers[exponent];
        } else {
            decimal exact;
            read_decimal(text, size, &exact);
            d = nearest(&exact);
        }
        d = text[0] == '-' ? -d : d;
        v = rvaft_real(d);
        if (v.tag == RVAFT_BIG && digits != NULL) {
            v = bytes_of(RVAFT_BIG, digits, digits_of(d, digits));
        }
    }
    return v;
}

#define MOST_DIGITS 4300

/* The number that a text writes as JSON does. */
RVAFT_UNUSED static rvaft_value number_of(int *error, rvaft_value v) {
    int point;
    if (is_number(&v)) {
        return v;
    }
    if (v.tag != RVAFT_TEXT || v.size == 0 || number_end(v.text, v.size, &point) != v.size) {
        return plain(RVAFT_UNDEFINED);
    }
    if (!point && v.size - (v.text[0] == '-') > MOST_DIGITS) {
        return plain(RVAFT_UNDEFINED);
    }
    v = read_number(v.text, v.size, point, NULL);
    return v.tag == RVAFT_BIG && v.text == NULL ? unsupported(error) : v;
}

/* Tests of fields. */

RVAFT_UNUSED static int is_text(const rvaft_value *v, const char *text, uint32_t size) {
    return v->tag == RVAFT_TEXT && v->size == size && (size == 0 || memcmp(v->text, text, size) == 0);
}

RVAFT_UNUSED static int is_integer(const rvaft_value *v, int64_t i) {
    return v->tag == RVAFT_INTEGER && v->integer == i;
}

RVAFT_UNUSED static int is_value(const rvaft_value *v, rvaft_value other) { return same(v, &other); }

RVAFT_UNUSED static rvaft_value later(rvaft_value a, rvaft_value b) {
    return a.tag == RVAFT_INTEGER && b.tag == RVAFT_INTEGER ? (a.integer < b.integer ? b : a) : plain(RVAFT_UNDEFINED);
}

RVAFT_UNUSED static rvaft_value earlier(rvaft_value a, rvaft_value b) {
    return a.tag == RVAFT_INTEGER && b.tag == RVAFT_INTEGER ? (a.integer > b.integer ? b : a) : plain(RVAFT_UNDEFINED);
}

static rvaft_value time_of(const rvaft_event *e) { return e->has_time ? integer(e->time) : plain(RVAFT_UNDEFINED); }

static rvaft_value value_of(const rvaft_monitor *m, const cell *c) {
    rvaft_value v = plain(c->tag);
    if (c->tag == RVAFT_INTEGER) {
        v.integer = c->bits;
    } else if (c->tag == RVAFT_REAL) {
        memcpy(&v.real, &c->bits, sizeof v.real);
    } else if (c->tag >= RVAFT_BIG) {
        v.text = m->texts.bytes + m->texts.start[c->bits];
        v.size = m->texts.size[c->bits];
    }
    return v;
}

#define OLD(n) value_of(m, &old[n])
#define E(n) (e->field[n])
#define AT time_of(e)

/* @tables */

/* An index is compared with the size of its array also where it is always in bounds: a static analysis
   of this file then proves that no access is wrong. */
static const stage *stage_of(const partial *p) { return &stages[p->stage < RVAFT_STAGES ? p->stage : 0]; }

#define FEW 63U /* the least mask of buckets */

/* Interned texts: each text of a partial match is stored once. */

static uint32_t mixed(uint64_t h) {
    h ^= h >> 32;
    h *= UINT64_C(0xD6E8FEB86659FD93);
    h ^= h >> 29;
    return (uint32_t)(h ^ h >> 32);
}

static uint32_t hash_bytes(uint64_t h, const char *text, uint32_t size) {
    uint32_t at = 0;
    h ^= size;
    for (; at + 8 <= size; at += 8) {
        uint64_t part;
        memcpy(&part, text + at, 8);
        h = (h ^ part) * UINT64_C(0x9E3779B97F4A7C15);
        h ^= h >> 31;
    }
    for (; at < size; at++) {
        h = (h ^ (unsigned char)text[at]) * UINT64_C(0x100000001B3);
        h ^= h >> 29;
    }
    return mixed(h);
}

static void mark_texts(rvaft_monitor *m) {
    uint32_t s, i, k;
    memset(m->texts.live, 0, sizeof m->texts.live);
    for (s = 0; s < RVAFT_STORES; s++) {
        for (i = 0; i < m->stores[s].count; i++) {
            const partial *p = &m->stores[s].item[i];
            for (k = 0; k < stage_of(p)->slots; k++) {
                if (p->slot[k].tag >= RVAFT_BIG) {
                    m->texts.live[p->slot[k].bits] = 1;
                }
            }
        }
    }
    for (i = 0; i < RVAFT_FIELDS; i++) {
        if (m->known[i] == 2 && m->cells[i].tag >= RVAFT_BIG) {
            m->texts.live[m->cells[i].bits] = 1;
        }
    }
}

/* Link all texts: those in use in their buckets, the others as free. */
static void relink_texts(pool *t) {
    uint32_t i;
    t->spare = NONE;
    for (i = 0; i <= t->mask; i++) {
        t->head[i] = NONE;
    }
    for (i = t->count; i-- > 0;) {
        uint32_t *first = t->size[i] == NONE ? &t->spare : &t->head[t->hash[i] & t->mask];
        t->next[i] = *first;
        *first = i;
    }
}

/* Remove the texts that no partial match has. Bytes move, so the texts are moved in their order. */
static void collect_texts(rvaft_monitor *m) {
    pool *t = &m->texts;
    uint32_t used = 0, at = 0;
    mark_texts(m);
    while (at < t->used) { /* each text is preceded by its number */
        uint32_t number, size;
        memcpy(&number, t->bytes + at, sizeof number);
        size = t->size[number];
        if (t->live[number]) {
            memmove(t->bytes + used, t->bytes + at, sizeof number + size);
            t->start[number] = used + (uint32_t)sizeof number;
            used += (uint32_t)sizeof number + size;
        } else {
            t->size[number] = NONE;
        }
        at += (uint32_t)sizeof number + size;
    }
    t->used = used;
    relink_texts(t);
}

static int has_room(const pool *t, uint32_t size) {
    return (t->spare != NONE || t->count < RVAFT_TEXTS) && size <= RVAFT_TEXT_BYTES - sizeof(uint32_t) &&
           t->used <= RVAFT_TEXT_BYTES - sizeof(uint32_t) - size;
}

/* The number of a text, or NONE if it is not stored (with `insert`: if there is no room). */
static uint32_t interned(rvaft_monitor *m, const rvaft_value *v, uint32_t hash, int insert) {
    pool *t = &m->texts;
    uint32_t i = t->head[hash & t->mask];
    for (; i != NONE; i = t->next[i]) {
        if (t->hash[i] == hash && t->size[i] == v->size && memcmp(t->bytes + t->start[i], v->text, v->size) == 0) {
            return i;
        }
    }
    if (!insert) {
        return NONE;
    }
    if (!has_room(t, v->size)) {
        collect_texts(m);
        if (!has_room(t, v->size)) {
            m->error = RVAFT_FULL;
            return NONE;
        }
    }
    if (t->count > t->mask && t->mask < RVAFT_BUCKETS - 1) {
        t->mask = t->mask < RVAFT_BUCKETS / 4 ? t->mask * 4 + 3 : RVAFT_BUCKETS - 1;
        relink_texts(t);
    }
    i = t->spare;
    if (i != NONE) {
        t->spare = t->next[i];
    } else {
        i = t->count++;
    }
    memcpy(t->bytes + t->used, &i, sizeof i);
    t->start[i] = t->used + (uint32_t)sizeof i;
    memcpy(t->bytes + t->start[i], v->text, v->size);
    t->used = t->start[i] + v->size;
    t->size[i] = v->size;
    t->hash[i] = hash;
    t->next[i] = t->head[hash & t->mask];
    t->head[hash & t->mask] = i;
    return i;
}

/* The cell of a field of the event. Without `insert` an unknown text has the number -1. */
static const cell *cell_of(rvaft_monitor *m, const rvaft_event *e, uint32_t field, int insert) {
    cell *c = &m->cells[field];
    const rvaft_value *v = &e->field[field];
    if (m->known[field] == 2 || (m->known[field] == 1 && !insert)) {
        return c;
    }
    c->tag = is_defined(v) ? v->tag : RVAFT_UNDEFINED;
    c->bits = 0;
    if (c->tag == RVAFT_INTEGER) {
        c->bits = v->integer;
    } else if (c->tag == RVAFT_REAL) {
        memcpy(&c->bits, &v->real, sizeof c->bits);
    }
    if (c->tag < RVAFT_BIG) {
        c->hash = mixed(((uint64_t)c->bits ^ m->seed ^ c->tag) * UINT64_C(0x9E3779B97F4A7C15));
        m->known[field] = 2;
    } else {
        uint32_t number;
        if (v->text == NULL) { /* a double of more than 64 bits */
            m->error = RVAFT_UNSUPPORTED;
            return c;
        }
        c->hash = hash_bytes(m->seed, v->text, v->size);
        number = interned(m, v, c->hash, insert);
        c->bits = number == NONE ? -1 : (int64_t)number;
        m->known[field] = number == NONE ? 1 : 2;
    }
    return c;
}

/* Stores. */

static void clear_store(store *s) {
    s->count = 0;
    s->mask = s->mask == 0 ? FEW : s->mask;
    s->epoch++;
    if (s->epoch == 0) {
        memset(s->buckets, 0, sizeof s->buckets);
        s->epoch = 1;
    }
}

static uint32_t bucket_of(const store *s, uint32_t stage_number, uint32_t link, const cell *const *cells,
                          uint32_t count) {
    uint64_t h = (uint64_t)stage_number * UINT64_C(0x9E3779B97F4A7C15) + link;
    uint32_t i;
    for (i = 0; i < count; i++) {
        h = (h ^ cells[i]->hash) * UINT64_C(0xD6E8FEB86659FD93);
        h ^= h >> 32;
    }
    return (uint32_t)(h ^ h >> 29) & s->mask;
}

static uint32_t first_in(const store *s, uint32_t link, uint32_t place) {
    const bucket *b = &s->buckets[link][place];
    return b->epoch == s->epoch ? b->head : NONE;
}

static void link_partial(store *s, uint32_t number) {
    partial *p = &s->item[number];
    const stage *st = stage_of(p);
    const cell *cells[RVAFT_WIDTH];
    uint32_t link, i, at = st->link;
    for (link = 0; link < st->links; link++) {
        uint32_t count = link_slots[at++], place;
        for (i = 0; i < count; i++) {
            cells[i] = &p->slot[link_slots[at++]];
        }
        place = bucket_of(s, p->stage, link, cells, count);
        p->next[link] = first_in(s, link, place);
        s->buckets[link][place].head = number;
        s->buckets[link][place].epoch = s->epoch;
    }
}

static int same_cell(const cell *a, const cell *b) { return a->tag == b->tag && a->bits == b->bits; }

/* Compare two partial matches of a stage with equal exact slots: 1 if `p` is at least as good as
   `q`, -1 if `q` is better, else 0. */
static int better(const stage *st, const partial *p, const partial *q) {
    uint32_t i;
    int p_good = 1, q_good = 1;
    for (i = st->exact; i < st->slots; i++) {
        int64_t a = p->slot[i].bits, b = q->slot[i].bits;
        if (a != b) {
            int p_wins = slot_order[st->order + i - st->exact] ? a < b : a > b;
            p_good = p_good && p_wins;
            q_good = q_good && !p_wins;
        }
    }
    return p_good ? 1 : q_good ? -1 : 0;
}

static void insert_partial(rvaft_monitor *m, store *s, const partial *p) {
    const stage *st = stage_of(p);
    const cell *cells[RVAFT_WIDTH];
    uint32_t i, at;
    for (i = 0; i < st->exact; i++) {
        cells[i] = &p->slot[i];
    }
    at = first_in(s, 0, bucket_of(s, p->stage, 0, cells, st->exact));
    for (; at < RVAFT_CAPACITY; at = s->item[at].next[0]) {
        partial *other = &s->item[at];
        if (other->stage == p->stage) {
            int equal = 1, order;
            for (i = 0; equal && i < st->exact; i++) {
                equal = same_cell(&p->slot[i], &other->slot[i]);
            }
            if (equal) {
                order = better(st, other, p);
                if (order > 0) {
                    return;
                }
                if (order < 0) {
                    for (i = st->exact; i < st->slots; i++) {
                        other->slot[i] = p->slot[i];
                    }
#if RVAFT_PLACES
                    other->taken = p->taken;
                    memcpy(other->events, p->events, sizeof p->events);
#endif
                    return;
                }
            }
        }
    }
    if (s->count >= RVAFT_CAPACITY) {
        m->error = RVAFT_FULL;
        return;
    }
    s->item[s->count] = *p;
    link_partial(s, s->count);
    s->count++;
}

static void insert_starts(rvaft_monitor *m, store *s) {
    partial p;
    uint32_t i;
    memset(&p, 0, sizeof p);
    for (i = 0; i < RVAFT_STARTS; i++) {
        p.stage = starts[i];
        insert_partial(m, s, &p);
    }
}

/* Try a move from a partial match; returns 1 if it detects. */
static int try_move(rvaft_monitor *m, store *to, const partial *p, const move *mv, const rvaft_event *e) {
    partial made;
    const stage *st = &stages[mv->target];
    uint32_t i;
    for (i = 0; i < mv->joins; i++) {
        const join *j = &joins[mv->join + i];
        const cell *c = cell_of(m, e, j->field, 0);
        if (c->tag == RVAFT_UNDEFINED || !same_cell(c, &p->slot[j->slot])) {
            return 0;
        }
    }
    if (mv->guard != 0 && (!guard(m, mv->guard, p->slot, e) || m->error != 0)) {
        return 0;
    }
    memset(&made, 0, sizeof made);
#if RVAFT_PLACES
    memcpy(made.events, p->events, p->taken * sizeof p->events[0]);
    made.events[p->taken] = e->at;
    made.taken = p->taken + 1;
    if (st->rank == 0) {
        m->match = made;
    }
#endif
    if (st->rank == 0) {
        return m->error == 0;
    }
    made.stage = mv->target;
    for (i = 0; i < st->slots; i++) {
        const load *l = &loads[mv->load + i];
        cell *c = &made.slot[i];
        rvaft_value t;
        if (l->from == COPY) {
            *c = p->slot[l->slot];
            continue;
        }
        if (l->from == FIELD) {
            *c = *cell_of(m, e, l->field, 1);
            continue;
        }
        t = AT;
        if (l->from != NOW) {
            rvaft_value before = value_of(m, &p->slot[l->slot]);
            t = l->from == LATEST ? later(before, t) : earlier(before, t);
        }
        c->tag = t.tag;
        c->bits = t.integer;
        c->hash = mixed(((uint64_t)c->bits ^ m->seed ^ c->tag) * UINT64_C(0x9E3779B97F4A7C15));
    }
    for (i = st->exact; i < st->slots; i++) {
        if (made.slot[i].tag == RVAFT_UNDEFINED) { /* a guard over this time can never hold */
            return 0;
        }
    }
    if (m->error == 0) {
        insert_partial(m, to, &made);
    }
    return 0;
}

#if RVAFT_SCATTERED

#if RVAFT_EXPIRIES
static int expired(const rvaft_monitor *m, const partial *p) {
    const stage *st = stage_of(p);
    uint32_t i;
    for (i = 0; i < st->expires; i++) {
        const expiry *x = &expiries[st->expiry + i];
        int64_t from = p->slot[x->slot].bits;
        if (m->latest > from && (uint64_t)m->latest - (uint64_t)from > (uint64_t)x->most + (uint64_t)RVAFT_LATE) {
            return 1;
        }
    }
    return 0;
}
#endif

/* Remove the partial matches that no further event can complete in time, and adapt the number of
   buckets; again when there are twice as many, so that the work per event stays bounded. */
static void sweep(rvaft_monitor *m, store *s) {
    uint32_t i, kept = 0, count = s->count;
    for (i = 0; i < count; i++) {
#if RVAFT_EXPIRIES
        if (m->has_latest && expired(m, &s->item[i])) {
            continue;
        }
#endif
        if (kept != i) {
            s->item[kept] = s->item[i];
        }
        kept++;
    }
    while (s->mask < RVAFT_BUCKETS - 1 && s->mask < 4 * kept) {
        s->mask = s->mask * 2 + 1;
    }
    clear_store(s);
    for (i = 0; i < kept; i++) {
        link_partial(s, i);
    }
    s->count = kept;
    m->sweep_at = kept < FEW ? 2 * FEW : kept < RVAFT_CAPACITY / 2 ? 2 * kept : kept + (RVAFT_CAPACITY - kept) / 2;
    m->sweep_at = m->sweep_at < RVAFT_CAPACITY ? m->sweep_at : RVAFT_CAPACITY - RVAFT_CAPACITY / 8;
}

/* Try all moves of a pattern, or of several in the order of ranks, so that no event is used twice. */
static int scattered(rvaft_monitor *m, const rvaft_event *e, const uint32_t *matched, uint32_t count) {
    store *s = &m->stores[0];
    uint32_t cursor[RVAFT_PATTERNS], i;
    if (s->count > m->sweep_at) {
        sweep(m, s);
    }
    for (i = 0; i < count; i++) {
        cursor[i] = pattern_moves[matched[i]];
    }
    for (;;) {
        uint32_t best = NONE, rank = NONE, number, at, k;
        const move *mv;
        const cell *cells[RVAFT_WIDTH];
        uint32_t width;
        const uint16_t *slots;
        for (i = 0; i < count; i++) {
            uint32_t next = cursor[i];
            if (next < pattern_moves[matched[i] + 1] && next < RVAFT_MOVES &&
                stages[moves[sorted_moves[next]].stage].rank < rank) {
                rank = stages[moves[sorted_moves[next]].stage].rank;
                best = i;
            }
        }
        if (best >= RVAFT_PATTERNS) {
            return 0;
        }
        at = cursor[best];
        if (at >= RVAFT_MOVES) {
            return 0;
        }
        cursor[best] = at + 1;
        number = sorted_moves[at];
        mv = &moves[number];
        slots = &link_slots[stages[mv->stage].link];
        for (k = 0; k < mv->link; k++) {
            slots += 1 + *slots;
        }
        width = *slots;
        for (k = 0; k < width; k++) {
            for (i = 0; joins[mv->join + i].slot != slots[1 + k]; i++) {
            }
            cells[k] = cell_of(m, e, joins[mv->join + i].field, 0);
        }
        at = first_in(s, mv->link, bucket_of(s, mv->stage, mv->link, cells, width));
        while (at < RVAFT_CAPACITY && m->error == 0) {
            const partial *p = &s->item[at];
            at = p->next[mv->link];
            if (p->stage == mv->stage && try_move(m, s, p, mv, e)) {
                return 1;
            }
        }
        if (m->error != 0) {
            return 0;
        }
    }
}

#else

/* Replace the partial matches by those that the event extends. */
static int replaced(rvaft_monitor *m, const rvaft_event *e, const uint8_t *matches) {
    store *from = &m->stores[m->now], *to = &m->stores[1 - m->now];
    uint32_t i, k;
    clear_store(to);
    for (i = 0; i < from->count; i++) {
        const partial *p = &from->item[i];
        const stage *st = stage_of(p);
        for (k = 0; k < st->moves; k++) {
            const move *mv = &moves[st->move + k];
            if (matches[mv->pattern]) {
                if (try_move(m, to, p, mv, e)) {
                    return 1;
                }
                if (m->error != 0) {
                    return 0;
                }
            }
        }
    }
    m->now = 1 - m->now;
    return 0;
}

#endif

static int is_late(rvaft_monitor *m, const rvaft_event *e) {
    int late = 0;
    if (RVAFT_LATE >= 0 && e->has_time) {
        if (m->has_latest && m->latest > e->time) {
            late = (uint64_t)m->latest - (uint64_t)e->time > (uint64_t)RVAFT_LATE;
        } else {
            m->latest = e->time;
            m->has_latest = 1;
        }
    }
    return late;
}

/* Start a monitor again after a detection; times are not forgotten. */
RVAFT_API void rvaft_again(rvaft_monitor *m) {
    m->verdict = RVAFT_UNKNOWN;
    m->now = 0;
    clear_store(&m->stores[0]);
    insert_starts(m, &m->stores[0]);
}

/* Initialise a monitor. The seed protects against texts chosen to have equal hashes. */
RVAFT_API void rvaft_init(rvaft_monitor *m, uint64_t seed) {
    memset(m, 0, sizeof *m);
    m->seed = seed;
    m->texts.mask = FEW;
    relink_texts(&m->texts);
    m->sweep_at = RVAFT_CAPACITY < 2 * FEW ? RVAFT_CAPACITY - RVAFT_CAPACITY / 8 : 2 * FEW;
    rvaft_again(m);
}

/* Read an event. Returns the verdict, or an error, after which the monitor must not be used. */
RVAFT_API int rvaft_step(rvaft_monitor *m, const rvaft_event *e) {
    uint8_t matches[RVAFT_PATTERNS];
    int late, found = 0;
    if (m->error != 0 || m->verdict == RVAFT_FALSE || m->verdict == RVAFT_TRUE) {
        return m->error != 0 ? m->error : m->verdict;
    }
    late = is_late(m, e);
#if RVAFT_PROJECTS
    if (late || !relevant(&m->error, e)) {
        return m->error != 0 ? m->error : m->verdict;
    }
#endif
    memset(m->known, 0, sizeof m->known);
#if RVAFT_SCATTERED
    if (!late) {
        uint32_t matched[RVAFT_PATTERNS], count = 0, i;
        match(matches, e);
        for (i = 0; i < RVAFT_PATTERNS; i++) {
            if (matches[i]) {
                matched[count++] = i;
            }
        }
        found = count != 0 && scattered(m, e, matched, count);
    }
#else
    if (late) {
        memset(matches, 0, sizeof matches);
    } else {
        match(matches, e);
    }
    found = replaced(m, e, matches);
#if RVAFT_CONSECUTIVE
    if (!found && m->error == 0) {
        insert_starts(m, &m->stores[m->now]);
    }
#else
    if (!found && m->stores[m->now].count == 0) {
        m->verdict = RVAFT_FALSE;
    }
#endif
#endif
    if (found) {
        m->verdict = RVAFT_TRUE;
    }
    return m->error != 0 ? m->error : m->verdict;
}

/* The state as bytes: equal states have equal futures. Returns their number; writes at most `size`
   of them (at least 12). The greatest time and each partial match are a record: its size, its bytes. */
RVAFT_API size_t rvaft_state(const rvaft_monitor *m, char *to, size_t size) {
    const store *s = &m->stores[m->now];
    size_t used = 0;
    uint32_t i, k;
    if (m->has_latest && size >= 12) {
        uint32_t record = sizeof m->latest;
        memcpy(to, &record, sizeof record);
        memcpy(to + 4, &m->latest, sizeof m->latest);
        used = 12;
    }
    for (i = 0; i < s->count; i++) {
        const partial *p = &s->item[i];
        uint32_t record = (uint32_t)sizeof p->stage;
        for (k = 0; k < stage_of(p)->slots; k++) {
            record += p->slot[k].tag >= RVAFT_BIG ? 8U + m->texts.size[p->slot[k].bits] : 12U;
        }
        if (used + sizeof record + record <= size) {
            memcpy(to + used, &record, sizeof record);
            memcpy(to + used + 4, &p->stage, 4);
            used += 8;
            for (k = 0; k < stage_of(p)->slots; k++) {
                const cell *c = &p->slot[k];
                memcpy(to + used, &c->tag, 4);
                if (c->tag >= RVAFT_BIG) {
                    uint32_t length = m->texts.size[c->bits];
                    memcpy(to + used + 4, &length, 4);
                    memcpy(to + used + 8, m->texts.bytes + m->texts.start[c->bits], length);
                    used += 8 + length;
                } else {
                    memcpy(to + used + 4, &c->bits, 8);
                    used += 12;
                }
            }
        } else {
            used += sizeof record + record;
        }
    }
    return used;
}

#if RVAFT_JSON

/* JSON: a scanner that validates a line and reads the fields of the tree. The byte after the line is
   no part of JSON (a newline), and eight more can be read. */

#define MAX_DEPTH 500
#define MEMBERS 4096

typedef struct member {
    size_t value; /* its place in the line */
    size_t end;
    uint32_t key; /* the decoded key in scratch */
    uint32_t size;
} member;

typedef struct frame {
    size_t start;
    int32_t node;
    uint32_t items;
    uint8_t object;
} frame;

typedef struct rvaft_reader {
    const char *text;
    size_t size;
    size_t at;
    const char *reason;
    uint32_t used; /* of scratch */
    uint32_t members;
    frame frames[MAX_DEPTH];
    member member[MEMBERS];
    char scratch[RVAFT_SCRATCH];
} rvaft_reader;

static int refused(rvaft_reader *r, const char *reason) {
    r->reason = reason;
    return RVAFT_MALFORMED;
}

static int full(rvaft_reader *r, const char *reason) {
    r->reason = reason;
    return RVAFT_FULL;
}

static uint32_t hex_digit(char c) {
    if (c >= '0' && c <= '9') {
        return (uint32_t)(c - '0');
    }
    if (c >= 'a' && c <= 'f') {
        return (uint32_t)(c - 'a') + 10;
    }
    return c >= 'A' && c <= 'F' ? (uint32_t)(c - 'A') + 10 : NONE;
}

/* The four hexadecimal digits at a place, or NONE. */
static uint32_t hex(const rvaft_reader *r, size_t at) {
    uint32_t i, n = 0;
    if (at + 4 > r->size) {
        return NONE;
    }
    for (i = 0; i < 4; i++) {
        uint32_t digit = hex_digit(r->text[at + i]);
        if (digit == NONE) {
            return NONE;
        }
        n = n * 16 + digit;
    }
    return n;
}

/* The size of the character in UTF-8 at a place, or 0. */
static size_t character(const rvaft_reader *r, size_t at) {
    unsigned char a = (unsigned char)r->text[at], b, c, d;
    size_t left = r->size - at;
    b = left > 1 ? (unsigned char)r->text[at + 1] : 0;
    c = left > 2 ? (unsigned char)r->text[at + 2] : 0;
    d = left > 3 ? (unsigned char)r->text[at + 3] : 0;
    if (a < 0x80U) {
        return 1;
    }
    if ((b & 0xC0U) != 0x80U || a < 0xC2U) {
        return 0;
    }
    if (a < 0xE0U) {
        return 2;
    }
    if ((c & 0xC0U) != 0x80U) {
        return 0;
    }
    if (a < 0xF0U) {
        return (a == 0xE0U && b < 0xA0U) || (a == 0xEDU && b >= 0xA0U) ? 0 : 3;
    }
    if ((d & 0xC0U) != 0x80U || a > 0xF4U) {
        return 0;
    }
    return (a == 0xF0U && b < 0x90U) || (a == 0xF4U && b >= 0x90U) ? 0 : 4;
}

/* The first of eight bytes whose high bit is set, or 0 where it is not known. */
#if defined(__GNUC__) && defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
#define FIRST_BYTE(w) ((size_t)__builtin_ctzll(w) / 8)
#else
#define FIRST_BYTE(w) 0
#endif

/* Pass a string whose quote is behind `at`; notes whether it has escapes. */
static int scan_string(rvaft_reader *r, int *escaped) {
    const uint64_t ones = UINT64_C(0x0101010101010101), high = ones * 0x80;
    size_t at = r->at;
    *escaped = 0;
    for (;;) {
        unsigned char c;
        uint64_t w;
        while (at + 8 <= r->size) {
            uint64_t quote, slash;
            memcpy(&w, r->text + at, 8);
            quote = w ^ (ones * 0x22);
            slash = w ^ (ones * 0x5C);
            w = (w | (w - ones * 0x20) | ((quote - ones) & ~quote) | ((slash - ones) & ~slash)) & high;
            if (w != 0) {
                at += FIRST_BYTE(w);
                break;
            }
            at += 8;
        }
        if (at >= r->size) {
            r->at = at;
            return refused(r, "unterminated string");
        }
        c = (unsigned char)r->text[at];
        if (c == '"') {
            r->at = at + 1;
            return 0;
        }
        if (c == '\\') {
            char kind = at + 1 < r->size ? r->text[at + 1] : 'x';
            *escaped = 1;
            if (kind == 'u') {
                uint32_t unit = hex(r, at + 2);
                r->at = at;
                if (unit == NONE) {
                    return refused(r, "invalid \\uXXXX escape");
                }
                at += 6;
                if (unit >= 0xD800U && unit < 0xE000U) {
                    uint32_t low = unit < 0xDC00U && at + 1 < r->size && r->text[at] == '\\' && r->text[at + 1] == 'u'
                                       ? hex(r, at + 2)
                                       : NONE;
                    if (low == NONE || low < 0xDC00U || low >= 0xE000U) {
                        return refused(r, "a lone surrogate: \\ud800 to \\udfff stand only in pairs");
                    }
                    at += 6;
                }
            } else if (kind == '"' || kind == '\\' || kind == '/' || kind == 'b' || kind == 'f' || kind == 'n' ||
                       kind == 'r' || kind == 't') {
                at += 2;
            } else {
                r->at = at;
                return refused(r, "invalid escape");
            }
        } else if (c < 0x20U) {
            r->at = at;
            return refused(r, "a control character in a string");
        } else if (c < 0x80U) {
            at++;
        } else {
            size_t size = character(r, at);
            if (size == 0) {
                r->at = at;
                return refused(r, "not UTF-8");
            }
            at += size;
        }
    }
}

static int put(rvaft_reader *r, uint32_t c) {
    if (r->used >= RVAFT_SCRATCH) {
        return full(r, "the texts of an event");
    }
    r->scratch[r->used++] = (char)(unsigned char)c;
    return 0;
}

static int put_bytes(rvaft_reader *r, const void *from, size_t size) {
    if (size > RVAFT_SCRATCH - r->used) {
        return full(r, "the texts of an event");
    }
    memcpy(r->scratch + r->used, from, size);
    r->used += (uint32_t)size;
    return 0;
}

/* Decode a valid string between two places into scratch. */
static int decode(rvaft_reader *r, size_t at, size_t end) {
    while (at < end) {
        uint32_t c = (unsigned char)r->text[at++];
        int error = 0;
        if (c != '\\') {
            error = put(r, c);
        } else {
            c = (unsigned char)r->text[at++];
            if (c != 'u') {
                static const char from[] = "bfnrt", to[] = "\b\f\n\r\t";
                uint32_t i;
                for (i = 0; i < 5; i++) {
                    if (c == (unsigned char)from[i]) {
                        c = (unsigned char)to[i];
                        break;
                    }
                }
                error = put(r, c);
            } else {
                c = hex(r, at);
                at += 4;
                if (c >= 0xD800U && c < 0xDC00U) {
                    c = 0x10000U + ((c - 0xD800U) << 10) + (hex(r, at + 2) - 0xDC00U);
                    at += 6;
                }
                if (c < 0x80U) {
                    error = put(r, c);
                } else if (c < 0x800U) {
                    error = put(r, 0xC0U | c >> 6) || put(r, 0x80U | (c & 0x3FU));
                } else if (c < 0x10000U) {
                    error = put(r, 0xE0U | c >> 12) || put(r, 0x80U | (c >> 6 & 0x3FU)) || put(r, 0x80U | (c & 0x3FU));
                } else {
                    error = put(r, 0xF0U | c >> 18) || put(r, 0x80U | (c >> 12 & 0x3FU)) ||
                            put(r, 0x80U | (c >> 6 & 0x3FU)) || put(r, 0x80U | (c & 0x3FU));
                }
            }
        }
        if (error) {
            return RVAFT_FULL;
        }
    }
    return 0;
}

static void pass_blanks(rvaft_reader *r) {
    size_t at = r->at, size = r->size;
    const char *text = r->text;
    while (at < size && (unsigned char)text[at] <= 0x20U &&
           (text[at] == ' ' || text[at] == '\t' || text[at] == '\r' || text[at] == '\n')) {
        at++;
    }
    r->at = at;
}

#define skip_blanks(r)                                                    \
    do {                                                                  \
        if ((r)->at < (r)->size && (unsigned char)(r)->text[(r)->at] <= 0x20U) { \
            pass_blanks(r);                                               \
        }                                                                 \
    } while (0)

static int is_word(const rvaft_reader *r, const char *word, size_t size) {
    return r->at + size <= r->size && memcmp(r->text + r->at, word, size) == 0;
}

static const char *passed_digits(const char *text) {
    while ((unsigned char)(*text - '0') <= 9) {
        text++;
    }
    return text;
}

/* As number_end, before a byte that is no part of a number. */
static uint32_t passed_number(const char *text, int *point) {
    const char *at = text + (*text == '-'), *from = at;
    *point = 0;
    at = *at == '0' ? at + 1 : passed_digits(at);
    if (at == from) {
        return 0;
    }
    if (*at == '.' && (unsigned char)(at[1] - '0') <= 9) {
        *point = 1;
        at = passed_digits(at + 2);
    }
    if (*at == 'e' || *at == 'E') {
        from = at + 1;
        from += *from == '+' || *from == '-';
        if ((unsigned char)(*from - '0') <= 9) {
            *point = 1;
            at = passed_digits(from);
        }
    }
    return (uint32_t)(at - text);
}

/* Pass a value that is no string, list or object; `v` may be NULL. */
static int scan_scalar(rvaft_reader *r, rvaft_value *v) {
    static const struct {
        const char *word;
        uint32_t size;
        uint32_t tag;
    } words[6] = {{"true", 4, RVAFT_YES},      {"false", 5, RVAFT_NO},          {"null", 4, RVAFT_NULL},
                  {"NaN", 3, RVAFT_UNDEFINED}, {"Infinity", 8, RVAFT_UNDEFINED}, {"-Infinity", 9, RVAFT_UNDEFINED}};
    const char *text = r->text + r->at;
    uint32_t size, i;
    int point;
    char c = text[0];
    if ((c < '0' || c > '9') && c != '-') {
        for (i = 0; i < 5; i++) {
            if (is_word(r, words[i].word, words[i].size)) {
                r->at += words[i].size;
                if (v != NULL) {
                    *v = plain(words[i].tag);
                }
                return 0;
            }
        }
        return refused(r, "expecting value");
    }
    size = passed_number(text, &point);
    if (size == 0) {
        if (is_word(r, words[5].word, words[5].size)) {
            r->at += words[5].size;
            if (v != NULL) {
                *v = plain(words[5].tag);
            }
            return 0;
        }
        return refused(r, "expecting value");
    }
    if (!point && size - (text[0] == '-') > MOST_DIGITS) {
        return refused(r, "a number of more than 4300 digits");
    }
    r->at += size;
    if (v != NULL) {
        char *digits = NULL;
        if (point && RVAFT_SCRATCH - r->used >= 320) {
            digits = r->scratch + r->used;
        }
        *v = read_number(text, size, point, digits);
        if (v->tag == RVAFT_BIG && v->text == digits && digits != NULL) {
            r->used += v->size;
        } else if (v->tag != RVAFT_BIG) { /* as written, for times */
            v->text = text;
            v->size = size;
        }
    }
    return 0;
}

/* Write the canonical form of the value at `r->at`, which is valid JSON: equal values have equal
   bytes. Sets `undefined` where a number is not finite. */
static int canonical(rvaft_reader *r, int *undefined) {
    int error, escaped;
    uint32_t start, size;
    size_t from;
    char c;
    skip_blanks(r);
    c = r->text[r->at];
    if (c == '"') {
        from = ++r->at;
        if (scan_string(r, &escaped) || put(r, '"') || put_bytes(r, "size", 4)) {
            return RVAFT_FULL;
        }
        start = r->used;
        if (decode(r, from, r->at - 1)) {
            return RVAFT_FULL;
        }
        size = r->used - start;
        memcpy(r->scratch + start - 4, &size, 4);
        return 0;
    }
    if (c == '[') {
        r->at++;
        error = put(r, '[');
        skip_blanks(r);
        while (!error && r->text[r->at] != ']') {
            error = canonical(r, undefined);
            skip_blanks(r);
            r->at += r->text[r->at] == ',';
            skip_blanks(r);
        }
        r->at++;
        return error ? error : put(r, ']');
    }
    if (c == '{') {
        uint32_t first = r->members, begin = r->used, i, k;
        size_t end;
        r->at++;
        skip_blanks(r);
        while (r->text[r->at] != '}') {
            member made;
            uint32_t keep;
            from = r->at + 1;
            r->at = from;
            if (r->members >= MEMBERS) {
                return full(r, "the fields of an object");
            }
            made.key = r->used;
            error = scan_string(r, &escaped);
            if (error || decode(r, from, r->at - 1)) {
                return RVAFT_FULL;
            }
            made.size = r->used - made.key;
            skip_blanks(r);
            r->at++;
            made.value = r->at;
            keep = r->used;
            r->member[r->members++] = made;
            error = canonical(r, undefined); /* to pass the value */
            if (error) {
                return error;
            }
            r->used = keep;
            skip_blanks(r);
            r->at += r->text[r->at] == ',';
            skip_blanks(r);
        }
        end = r->at + 1;
        for (i = first + 1; i < r->members; i++) { /* few fields: insertion sort */
            member moved = r->member[i];
            rvaft_value key = bytes_of(RVAFT_TEXT, r->scratch + moved.key, moved.size);
            for (k = i; k > first; k--) {
                rvaft_value other =
                    bytes_of(RVAFT_TEXT, r->scratch + r->member[k - 1].key, r->member[k - 1].size);
                if (compare_bytes(&other, &key) <= 0) {
                    break;
                }
                r->member[k] = r->member[k - 1];
            }
            r->member[k] = moved;
        }
        start = r->used; /* behind the keys, over which the object then moves */
        error = put(r, '{');
        for (i = first; !error && i < r->members; i++) {
            member one = r->member[i];
            if (i > first && one.size == r->member[i - 1].size &&
                (one.size == 0 || memcmp(r->scratch + one.key, r->scratch + r->member[i - 1].key, one.size) == 0)) {
                return refused(r, "a key is repeated");
            }
            if (put_bytes(r, &one.size, 4) || put_bytes(r, r->scratch + one.key, one.size)) {
                return RVAFT_FULL;
            }
            r->at = one.value;
            error = canonical(r, undefined);
        }
        r->members = first;
        r->at = end;
        if (error || put(r, '}')) {
            return error ? error : RVAFT_FULL;
        }
        memmove(r->scratch + begin, r->scratch + start, r->used - start);
        r->used -= start - begin;
        return 0;
    }
    {
        rvaft_value v;
        char digits[320];
        start = r->used;
        error = scan_scalar(r, &v);
        if (error) {
            return error;
        }
        *undefined |= v.tag == RVAFT_UNDEFINED;
        if (v.tag == RVAFT_BIG && v.text == NULL) {
            return full(r, "the texts of an event");
        }
        if (r->used != start) { /* digits that the scanner wrote */
            memcpy(digits, v.text, v.size);
            v.text = digits;
            r->used = start;
        }
        error = put(r, 'a' + v.tag);
        if (v.tag == RVAFT_INTEGER) {
            error = error || put_bytes(r, &v.integer, 8);
        } else if (v.tag == RVAFT_REAL) {
            error = error || put_bytes(r, &v.real, 8);
        } else if (v.tag == RVAFT_BIG) {
            error = error || put_bytes(r, &v.size, 4) || put_bytes(r, v.text, v.size);
        }
        return error ? RVAFT_FULL : 0;
    }
}

/* The node for a key below a node, or -1. */
static int32_t child_of(const rvaft_reader *r, int32_t node, const char *key, uint32_t size) {
    int32_t child = node < -1 ? FIRST_FIELD : fields[node].child;
    (void)r;
    while (child >= 0 && !(fields[child].size == size && fields[child].name != NULL &&
                           (size == 0 || (fields[child].name[0] == key[0] &&
                                          memcmp(fields[child].name, key, size) == 0)))) {
        child = fields[child].next;
    }
    return child;
}

static int32_t item_of(int32_t node, uint32_t item) {
    int32_t child = node < 0 ? -1 : fields[node].child;
    while (child >= 0 && !(fields[child].name == NULL && fields[child].size == item)) {
        child = fields[child].next;
    }
    return child;
}

/* The value of a list or an object between two places of the line. */
static int whole_value(rvaft_reader *r, rvaft_value *v, size_t start) {
    size_t end = r->at;
    uint32_t used = r->used;
    int undefined = 0, error;
    r->at = start;
    r->members = 0;
    error = canonical(r, &undefined);
    if (error == 0 && !undefined) {
        v->text = r->scratch + used;
        v->size = r->used - used;
    }
    if (error == 0) {
        r->at = end;
    }
    return error;
}

/* Read a line as one JSON object: 0, or an error with its reason in `reason`. */
static int scan(rvaft_reader *r, rvaft_event *e) {
    uint32_t depth = 0, i;
    int32_t node = -2; /* the event itself; -1 is what the tree does not read */
    int escaped, error;
    for (i = 0; i < RVAFT_FIELDS; i++) {
        e->field[i].tag = RVAFT_ABSENT;
    }
    r->used = 0;
    r->at = 0;
    skip_blanks(r);
    for (;;) { /* a value of `node` */
        char c = r->at < r->size ? r->text[r->at] : '\n';
        if (c == '{' || c == '[') {
            frame *f = &r->frames[depth];
            if (depth >= MAX_DEPTH) {
                return refused(r, "nested more than 500 levels deep");
            }
            if (depth == 0 && c == '[') {
                return refused(r, "not a JSON object");
            }
            depth++;
            f->object = c == '{';
            f->node = node;
            f->start = r->at;
            f->items = 0;
            if (node >= 0) {
                e->field[node] = plain(f->object ? RVAFT_OBJECT : RVAFT_LIST);
            }
            r->at++;
            skip_blanks(r);
            if (r->at < r->size && r->text[r->at] == (f->object ? '}' : ']')) {
                goto closed;
            }
            if (f->object) {
                goto key;
            }
            f->items = 1;
            node = item_of(node, 0);
            continue;
        }
        if (depth == 0) {
            return refused(r, c == '"' || c == '-' || (c >= '0' && c <= '9') ? "not a JSON object" : "expecting value");
        }
        if (c == '"') {
            size_t start = ++r->at;
            error = scan_string(r, &escaped);
            if (error) {
                return error;
            }
            if (node >= 0) {
                if (escaped) {
                    uint32_t used = r->used;
                    if (decode(r, start, r->at - 1)) {
                        return RVAFT_FULL;
                    }
                    e->field[node] = bytes_of(RVAFT_TEXT, r->scratch + used, r->used - used);
                } else {
                    e->field[node] = bytes_of(RVAFT_TEXT, r->text + start, (uint32_t)(r->at - 1 - start));
                }
            }
        } else {
            error = scan_scalar(r, node >= 0 ? &e->field[node] : NULL);
            if (error) {
                return error;
            }
        }
        for (;;) { /* after a value */
            frame *f;
            skip_blanks(r);
            if (depth == 0) {
                return r->at == r->size ? 0 : refused(r, "extra data");
            }
            f = &r->frames[depth - 1];
            c = r->at < r->size ? r->text[r->at] : '\n';
            if (c == ',') {
                r->at++;
                skip_blanks(r);
                if (f->object) {
                    goto key;
                }
                node = item_of(f->node, f->items++);
                break;
            }
            if (c != (f->object ? '}' : ']')) {
                return refused(r, "expecting ',' delimiter");
            }
        closed:
            f = &r->frames[depth - 1];
            r->at++;
            depth--;
            if (f->node >= 0) {
                rvaft_value *v = &e->field[f->node];
                v->integer = f->items;
                if (fields[f->node].whole) {
                    error = whole_value(r, v, f->start);
                    if (error) {
                        return error;
                    }
                }
            }
        }
        continue;
    key: {
        frame *f = &r->frames[depth - 1];
        size_t start = r->at + 1;
        if (r->at >= r->size || r->text[r->at] != '"') {
            return refused(r, "expecting property name enclosed in double quotes");
        }
        r->at = start;
        error = scan_string(r, &escaped);
        if (error) {
            return error;
        }
        node = -1;
        if (f->node != -1) {
            if (escaped) {
                uint32_t used = r->used;
                if (decode(r, start, r->at - 1)) {
                    return RVAFT_FULL;
                }
                node = child_of(r, f->node, r->scratch + used, r->used - used);
                r->used = used;
            } else {
                node = child_of(r, f->node, r->text + start, (uint32_t)(r->at - 1 - start));
            }
            if (node >= 0 && e->field[node].tag != RVAFT_ABSENT) {
                return refused(r, "a key is repeated");
            }
        }
        skip_blanks(r);
        if (r->at >= r->size || r->text[r->at] != ':') {
            return refused(r, "expecting ':' delimiter");
        }
        r->at++;
        skip_blanks(r);
    }
    }
}

#if RVAFT_TIMED

#define SECOND INT64_C(1000000000)

static int read_two(const char *text, int *number) {
    if (text[0] < '0' || text[0] > '9' || text[1] < '0' || text[1] > '9') {
        return 0;
    }
    *number = (text[0] - '0') * 10 + (text[1] - '0');
    return 1;
}

/* Seconds and nanoseconds as a time: 1, or an error. */
static int instant(int64_t seconds, int64_t rest, int64_t *time) {
    int error = 0;
    rvaft_value t = add(&error, multiply(&error, integer(seconds), integer(SECOND)), integer(rest));
    if (error != 0) {
        return error;
    }
    *time = t.integer;
    return 1;
}

/* A decimal number of units of 10^scale nanoseconds, half to even: 1, 0 if undefined, or an error. */
RVAFT_UNUSED static int decimal_time(const rvaft_value *v, int scale, int64_t *time) {
    decimal d;
    uint64_t n;
    int point;
    int minus;
    if (v->tag == RVAFT_TEXT ? v->size == 0 || v->size > 1000 || number_end(v->text, v->size, &point) != v->size
                             : !is_number(v) || v->text == NULL) {
        return 0;
    }
    minus = v->text[0] == '-';
    read_decimal(v->text, v->size, &d);
    *time = 0;
    if (d.count == 0 || d.point < -39) {
        return 1;
    }
    if (d.point > 31) {
        return 0;
    }
    d.point += scale;
    if (d.point > 19) {
        return RVAFT_UNSUPPORTED;
    }
    n = rounded(&d);
    if (n > (uint64_t)INT64_MAX) {
        return RVAFT_UNSUPPORTED;
    }
    *time = minus ? -(int64_t)n : (int64_t)n;
    return 1;
}

/* A number of 100 ns since 1601-01-01: 1, 0 if undefined, or an error. */
RVAFT_UNUSED static int filetime(const rvaft_value *v, int64_t *time) {
    int found, error = 0;
    int64_t rest, ticks = 0;
    rvaft_value t;
    decimal d;
    found = decimal_time(v, -40, &rest);
    if (found != 1) {
        return found;
    }
    read_decimal(v->text, v->size, &d);
    if (d.point > 18) {
        return RVAFT_UNSUPPORTED;
    }
    while (d.point > 0) { /* the whole number apart: with two more digits it may need more than 64 bits */
        ticks = ticks * 10 + (d.count > 0 ? d.digit[0] : 0);
        if (d.count > 0) {
            memmove(d.digit, d.digit + 1, (size_t)--d.count);
        }
        d.point--;
    }
    d.point += 2;
    rest = (int64_t)rounded(&d);
    if (v->text[0] == '-') {
        ticks = -ticks;
        rest = -rest;
    }
    t = multiply(&error, integer(ticks - INT64_C(116444736000000000)), integer(100));
    t = add(&error, t, integer(rest));
    *time = t.integer;
    return error != 0 ? error : 1;
}

static int64_t day_number(int year, int month, int day) { /* from 1970-01-01 */
    int64_t y = year - (month <= 2), era = y / 400, of_era = y - era * 400;
    int64_t of_year = (153 * (month + (month > 2 ? -3 : 9)) + 2) / 5 + day - 1;
    return era * 146097 + of_era * 365 + of_era / 4 - of_era / 100 + of_year - 719468;
}

static int is_day(int year, int month, int day) {
    static const int days[12] = {31, 28, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
    int leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    return year >= 1 && month >= 1 && month <= 12 && day >= 1 && day <= days[month - 1] + (month == 2 && leap);
}

/* An offset of a zone such as +02:00 at a place, in seconds; returns the place after it, or NONE. */
static uint32_t offset_of(const char *text, uint32_t at, uint32_t size, int *seconds) {
    int hours, minutes = 0, sign = text[at] == '-' ? -1 : 1;
    at++;
    if (at + 2 > size || !read_two(text + at, &hours)) {
        return NONE;
    }
    at += 2;
    if (at + 2 <= size && read_two(text + at, &minutes)) {
        at += 2;
    } else if (at + 3 <= size && text[at] == ':' && read_two(text + at + 1, &minutes)) {
        at += 3;
    }
    if (hours > 23 || minutes > 59) {
        return NONE;
    }
    *seconds = sign * (hours * 60 + minutes) * 60;
    return at;
}

/* The nanoseconds that decimals of a second write, half to even. */
static int64_t decimals_of(const char *text, uint32_t size) {
    decimal d;
    uint32_t i;
    d.count = 0;
    d.point = 0;
    d.truncated = 0;
    for (i = 0; i < size; i++) {
        if (d.count < DIGITS) {
            d.digit[d.count++] = (uint8_t)(text[i] - '0');
        } else {
            d.truncated |= text[i] != '0';
        }
    }
    trim(&d);
    if (d.count == 0) {
        return 0;
    }
    d.point = 9;
    return (int64_t)rounded(&d);
}

RVAFT_UNUSED static int iso_time(const rvaft_value *v, int64_t *time) {
    const char *t = v->text;
    uint32_t at = 16, size = v->size;
    int century, year, month, day, hour, minute, second = 0, ahead = 0;
    int64_t rest = 0;
    if (v->tag != RVAFT_TEXT || size < 16 || size > 1000 || !read_two(t, &century) || !read_two(t + 2, &year) ||
        t[4] != '-' || !read_two(t + 5, &month) || t[7] != '-' || !read_two(t + 8, &day) ||
        (t[10] != 'T' && t[10] != 't' && t[10] != ' ') || !read_two(t + 11, &hour) || t[13] != ':' ||
        !read_two(t + 14, &minute)) {
        return 0;
    }
    year += century * 100;
    if (at + 3 <= size && t[at] == ':' && read_two(t + at + 1, &second)) {
        at += 3;
        if (at + 1 < size && (t[at] == '.' || t[at] == ',') && t[at + 1] >= '0' && t[at + 1] <= '9') {
            uint32_t from = ++at;
            while (at < size && t[at] >= '0' && t[at] <= '9') {
                at++;
            }
            rest = decimals_of(t + from, at - from);
        }
    }
    if (at < size && (t[at] == 'Z' || t[at] == 'z')) {
        at++;
    } else if (at < size && (t[at] == '+' || t[at] == '-')) {
        at = offset_of(t, at, size, &ahead);
    }
    if (at != size || !is_day(year, month, day) || hour > 23 || minute > 59 || second > 60) {
        return 0;
    }
    return instant(((day_number(year, month, day) * 24 + hour) * 60 + minute) * 60 + second - ahead, rest, time);
}

static int is_written_integer(const rvaft_value *v) {
    uint32_t i;
    if (!is_number(v) || v->text == NULL) {
        return 0;
    }
    for (i = 0; i < v->size; i++) {
        if (v->text[i] == '.' || v->text[i] == 'e' || v->text[i] == 'E') {
            return 0;
        }
    }
    return v->tag != RVAFT_BIG || i != 0;
}

/* {sec, nanosec} or {secs, nsecs}, both integers. */
RVAFT_UNUSED static int ros_time(const rvaft_value *sec, const rvaft_value *nanosec, const rvaft_value *secs,
                                 const rvaft_value *nsecs, int64_t *time) {
    if (!is_written_integer(sec) || !is_written_integer(nanosec)) {
        if (!is_written_integer(secs) || !is_written_integer(nsecs)) {
            return 0;
        }
        sec = secs;
        nanosec = nsecs;
    }
    if (sec->tag == RVAFT_BIG || nanosec->tag == RVAFT_BIG) {
        return RVAFT_UNSUPPORTED;
    }
    return instant(sec->integer, nanosec->integer, time);
}

#endif

/* Read a line as an event: 0, or an error. */
RVAFT_API int rvaft_read(rvaft_reader *r, const char *text, size_t size, rvaft_event *e) {
    int error, found = 0;
    r->text = text;
    r->size = size;
    r->reason = "";
    e->has_time = 0;
    e->time = 0;
    if (size > UINT32_MAX / 2) {
        return full(r, "the bytes of a line");
    }
    error = scan(r, e);
#if RVAFT_TIMED
    if (error == 0) {
        found = READ_TIME(e, &e->time);
        if (found < 0) {
            r->reason = "a time of more than 64 bits";
            return found;
        }
        e->has_time = found;
    }
#endif
    (void)found;
    return error;
}

/* Read a line of a log and step: a verdict or an error. */
RVAFT_API int rvaft_line(rvaft_monitor *m, rvaft_reader *r, const char *text, size_t size) {
    rvaft_event e;
    int error = rvaft_read(r, text, size, &e);
    return error != 0 ? error : rvaft_step(m, &e);
}

RVAFT_API size_t rvaft_size(void) { return sizeof(rvaft_monitor); }

RVAFT_API size_t rvaft_reader_size(void) { return sizeof(rvaft_reader); }

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
static rvaft_reader the_reader;
static char input[RVAFT_LINE + 2U * CHUNK + 16U];
static char output[OUTPUT];
static size_t written;

typedef struct options {
    int repeat;
    int detections;
    int several;
    int strict;
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

/* Write the name of a trace as a JSON string. */
static int write_name(const char *name) {
    int good = write_text("{\"trace\": \"");
    for (; good && *name != '\0'; name++) {
        unsigned char c = (unsigned char)*name;
        if (c == '"' || c == '\\') {
            good = write_text("\\");
        }
        if (c < 0x20U) {
            char escape[8];
            good = good && snprintf(escape, sizeof escape, "\\u%04x", c) == 6 && write_text(escape);
        } else {
            good = good && write_bytes(name, 1);
        }
    }
    return good && write_text("\", ");
}

/* Write the record of an event; with `line` as it changes the verdict. */
static int write_record(const options *o, const char *name, uint64_t number, int verdict, uint64_t line,
                        uint64_t detection) {
    static const char *const ends[3] = {", \"verdict\": \"unknown\"", ", \"verdict\": \"true\"",
                                        ", \"verdict\": \"false\""};
    int good = (o->several ? write_name(name) : write_text("{")) && write_text("\"event\": ") &&
               write_number(number) && write_text(ends[verdict]);
    if (good && line != 0) {
        good = write_text(", \"line\": ") && write_number(line);
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

static int is_blank(const char *text, size_t size) {
    size_t at;
    for (at = 0; at < size; at++) {
        if (text[at] != ' ' && text[at] != '\t' && text[at] != '\r' && text[at] != '\n') {
            return 0;
        }
    }
    return 1;
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
    rvaft_init(&the_monitor, seed);
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
    return found;
}

static int help(void) {
    puts("usage: monitor [--repeat] [--detections] [FILE...]\n\n"
         "Read JSON Lines from each FILE, or from standard input, and write a verdict for each event.\n"
         "--repeat restarts the monitor after each detection; --detections writes detections only.\n"
         "The exit status is 1 if a trace detects, 0 if none does, 2 on an error in the input, and 3\n"
         "if the monitor has no verdict.");
    return 0;
}

int main(int argc, char **argv) {
    options o = {0, 0, 0, 0};
    int i, status = 0, files = 0, only = 0;
    uint64_t seed = (uint64_t)time(NULL) * UINT64_C(0x9E3779B97F4A7C15) ^ (uint64_t)(uintptr_t)argv;
    for (i = 1; i < argc; i++) {
        if (only || argv[i][0] != '-' || argv[i][1] == '\0') {
            argv[++files] = argv[i];
        } else if (strcmp(argv[i], "--") == 0) {
            only = 1;
        } else if (strcmp(argv[i], "--repeat") == 0) {
            o.repeat = 1;
        } else if (strcmp(argv[i], "--detections") == 0) {
            o.detections = 1;
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
