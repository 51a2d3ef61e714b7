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
    RVAFT_FULL = -1,        /* an array is full: compile with a larger RVAFT_CAPACITY (or RVAFT_KEYS) */
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

/* @types */
#if RVAFT_NAMED
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
#endif

#if RVAFT_KEYED
/* A key of the log, with what a monitor of its own has. Partial matches of an earlier era are void. */
typedef struct key_state {
    int64_t latest;
    int has_latest;
    int verdict;
    int found; /* whether it has detected */
    uint32_t era;
    uint32_t next; /* in its bucket, or the next free one */
    uint32_t hash;
    uint32_t start; /* of its bytes */
    uint32_t size;
} key_state;

/* The keys, with those that are free. A number precedes the bytes of each key. */
typedef struct key_table {
    int64_t newest;  /* the greatest time of all keys, while keys are forgotten */
    int64_t horizon; /* an earlier event may need one of a forgotten key */
    uint64_t forgotten;
    uint64_t early; /* the keys that began with such an event */
    uint64_t births;
    int lasts; /* whether no key is forgotten */
    int full;
    uint32_t count;
    uint32_t spare; /* the first free key, or NONE */
    uint32_t kept;  /* the keys that are not free */
    uint32_t used;  /* bytes */
    uint32_t head[RVAFT_KEYS];
    key_state item[RVAFT_KEYS];
    uint64_t birth[RVAFT_KEYS]; /* how many keys began until then, or 0 if free */
    uint8_t live[RVAFT_KEYS];   /* whether a later event can be in a match with one of the key */
    char bytes[RVAFT_KEY_BYTES];
} key_table;
#endif

typedef struct rvaft_monitor {
    uint64_t seed;
    int64_t latest; /* the greatest time so far */
    int has_latest;
    int verdict;
    int error;
    int changed;  /* whether the last event changed the verdict */
#if RVAFT_KEYED
    uint32_t key; /* of the last event, or NONE if it lacks a field */
#if RVAFT_PLACES
    uint64_t first_early; /* the number of the first event of a key that may need one of a forgotten key */
#endif
    key_table keys;
#endif
/* @members */
#if RVAFT_NAMED
    pool texts;
    cell cells[RVAFT_FIELDS]; /* of the event */
#endif
    uint8_t known[RVAFT_FIELDS];
} rvaft_monitor;

/* @rows */
/* A node of the fields that the tree reads: a key, or (without a name) the item of a list. */
typedef struct field_node {
    const char *name;
    uint32_t size; /* of the name, or the number of the item */
    int32_t child;
    int32_t next;
    uint64_t keys; /* the hashes of the keys below */
    uint8_t whole; /* whether a list or an object is compared as a whole */
    uint8_t time;  /* whether a number is read as a time only, of which its text is enough */
} field_node;

/* Values. */

/*@ assigns \nothing;
    ensures \result.tag == tag; */
RVAFT_UNUSED static rvaft_value plain(uint32_t tag) {
    rvaft_value v = {NULL, 0.0, 0, 0, 0};
    v.tag = tag;
    return v;
}

RVAFT_UNUSED static rvaft_value truth(int yes) { return plain(yes ? RVAFT_YES : RVAFT_NO); }

/*@ assigns \nothing;
    ensures \result.tag == RVAFT_INTEGER && \result.integer == i; */
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
/*@ assigns \nothing; */
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

/*@ requires \valid_read(v);
    assigns \nothing;
    ensures \result != 0 <==> RVAFT_INTEGER <= v->tag <= RVAFT_BIG; */
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
    return order != 0 ? (order < 0 ? -1 : 1) : a->size < b->size ? -1 : a->size > b->size;
}

static int sign_of_big(const rvaft_value *v) { return v->text != NULL && v->text[0] == '-' ? -1 : 1; }

/* The order of an integer and a double that is no integer: as that is less than 2^53, the order is kept
   where the integer is rounded. */
static int compare_with_real(int64_t i, double d) { return (double)i < d ? -1 : 1; }

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
    return a->tag == RVAFT_REAL ? -compare_with_real(b->integer, a->real) : compare_with_real(a->integer, b->real);
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

/*@ requires \valid(error);
    assigns *error;
    ensures *error == RVAFT_UNSUPPORTED && \result.tag == RVAFT_UNDEFINED; */
static rvaft_value unsupported(int *error) {
    *error = RVAFT_UNSUPPORTED;
    return plain(RVAFT_UNDEFINED);
}

/*@ requires \valid(error);
    assigns *error;
    ensures *error == \old(*error) || *error == RVAFT_UNSUPPORTED; */
static rvaft_value result(int *error, double d) {
    rvaft_value v = rvaft_real(d);
    return v.tag == RVAFT_BIG ? unsupported(error) : v;
}

/*@ requires \valid_read(v);
    assigns \nothing; */
static double as_real(const rvaft_value *v) { return v->tag == RVAFT_INTEGER ? (double)v->integer : v->real; }

/* Whether a calculation has an operand that is no number (then `a` becomes UNDEFINED) or too large. */
/*@ requires \valid(error) && \valid(a) && \valid_read(b) && \separated(error, a) && \separated(error, b);
    assigns *error, *a;
    ensures *error == \old(*error) || *error == RVAFT_UNSUPPORTED;
    ensures \result != 0 ==> a->tag == RVAFT_UNDEFINED;
    ensures \result == 0 ==> *a == \old(*a) && *error == \old(*error);
    ensures \old(a->tag) == RVAFT_INTEGER && \old(b->tag) == RVAFT_INTEGER ==> \result == 0; */
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

/*@ requires \valid(error);
    assigns *error;
    ensures *error == \old(*error) || *error == RVAFT_UNSUPPORTED; */
RVAFT_UNUSED static rvaft_value add(int *error, rvaft_value a, rvaft_value b) {
    int64_t sum;
    if (unusable(error, &a, &b)) {
        return a;
    }
    if (a.tag != RVAFT_INTEGER || b.tag != RVAFT_INTEGER) {
        return result(error, as_real(&a) + as_real(&b));
    }
    sum = (int64_t)((uint64_t)a.integer + (uint64_t)b.integer);
    return ((a.integer ^ sum) & (b.integer ^ sum)) < 0 ? unsupported(error) : integer(sum);
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

/*@ requires \valid(error);
    assigns *error;
    ensures *error == \old(*error) || *error == RVAFT_UNSUPPORTED; */
RVAFT_UNUSED static rvaft_value subtract(int *error, rvaft_value a, rvaft_value b) {
    int64_t difference;
    if (unusable(error, &a, &b)) {
        return a;
    }
    if (a.tag != RVAFT_INTEGER || b.tag != RVAFT_INTEGER) {
        return result(error, as_real(&a) - as_real(&b));
    }
    difference = (int64_t)((uint64_t)a.integer - (uint64_t)b.integer);
    return ((a.integer ^ b.integer) & (a.integer ^ difference)) < 0 ? unsupported(error) : integer(difference);
}

/*@ assigns \nothing; */
static uint64_t magnitude(int64_t i) { return i < 0 ? 0U - (uint64_t)i : (uint64_t)i; }

/*@ requires \valid(error);
    assigns *error;
    ensures *error == \old(*error) || *error == RVAFT_UNSUPPORTED; */
RVAFT_UNUSED static rvaft_value multiply(int *error, rvaft_value a, rvaft_value b) {
    uint64_t left, right, product;
    if (unusable(error, &a, &b)) {
        return a;
    }
    if (a.tag != RVAFT_INTEGER || b.tag != RVAFT_INTEGER) {
        return result(error, as_real(&a) * as_real(&b));
    }
    left = magnitude(a.integer);
    right = magnitude(b.integer);
    product = left * right;
    if ((left != 0 && right > (uint64_t)INT64_MAX / left) || product > (uint64_t)INT64_MAX) {
        return unsupported(error);
    }
    return integer((a.integer < 0) == (b.integer < 0) ? (int64_t)product : -(int64_t)product);
}

/* The double that is nearest to the quotient of two integers. */
/*@ assigns \nothing; */
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

/*@ requires \valid(error);
    assigns *error;
    ensures *error == \old(*error) || *error == RVAFT_UNSUPPORTED; */
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

/* Decimals: exact conversion between decimal digits and doubles. Conditions on a bound that always
   holds let a static analysis of this file prove that nothing overflows. */

#define DIGITS 800U
#define MORE 24U /* digits that a shift adds */
#define FAR 100000 /* a power of 10 of which no double is near */
#define DIGIT(c) ((unsigned char)(c) & 0xFU)

typedef struct decimal {
    uint32_t count; /* of digits, without zeros at the end */
    int point;      /* the value is 0.ddd * 10^point */
    int truncated;  /* whether digits were lost, which were not all zero */
    uint8_t digit[DIGITS + 2U * MORE];
} decimal;

static uint32_t count_of(const decimal *d) { return d->count < DIGITS ? d->count : DIGITS; }

static void trim(decimal *d) {
    uint32_t i, count = d->count;
    for (i = DIGITS; i < count && i < DIGITS + MORE; i++) {
        d->truncated |= d->digit[i] != 0;
    }
    count = count_of(d);
    while (count > 0 && d->digit[count - 1] == 0) {
        count--;
    }
    d->count = count;
    if (count == 0) {
        d->point = 0;
    }
}

static void shift_left(decimal *d, int bits) {
    uint64_t rest = 0;
    uint32_t i, first = MORE, count = count_of(d);
    for (i = count; i > 0; i--) {
        rest += (uint64_t)d->digit[i - 1] << bits;
        d->digit[i - 1 + MORE] = (uint8_t)(rest % 10);
        rest /= 10;
    }
    while (rest != 0 && first > 0) {
        d->digit[--first] = (uint8_t)(rest % 10);
        rest /= 10;
    }
    d->count = count + MORE - first;
    d->point += d->point < FAR ? (int)(MORE - first) : 0;
    memmove(d->digit, d->digit + first, d->count);
    trim(d);
}

static void shift_right(decimal *d, int bits) {
    uint64_t rest = 0, mask = (UINT64_C(1) << bits) - 1;
    uint32_t count = count_of(d), from = 0, to = 0;
    while (rest >> bits == 0 && (from < count || rest != 0) && from < DIGITS + MORE) {
        rest = rest * 10 + (from < count ? d->digit[from] : 0U);
        from++;
    }
    d->point -= d->point > -FAR && from > 0 ? (int)from - 1 : 0;
    while (from < count || rest != 0) {
        uint8_t digit = (uint8_t)(rest >> bits);
        rest = (rest & mask) * 10;
        if (from < count) {
            rest += d->digit[from++];
        }
        if (to < DIGITS) {
            d->digit[to++] = digit;
        } else {
            d->truncated |= digit != 0;
        }
    }
    d->count = to;
    trim(d);
}

static uint64_t rounded(const decimal *d) {
    uint64_t n = 0;
    int i, up = 0, count = (int)count_of(d);
    for (i = 0; i < d->point && i < count; i++) {
        n = n * 10 + d->digit[i];
    }
    for (; i < d->point; i++) {
        n *= 10;
    }
    if (d->point >= 0 && d->point < count) {
        up = d->digit[d->point] >= 5;
        if (d->digit[d->point] == 5 && d->point + 1 == count) {
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
    while (d->point > 0 && exponent < FAR) {
        int bits = d->point >= 9 ? 27 : steps[d->point];
        shift_right(d, bits);
        exponent += bits;
    }
    while ((d->point < 0 || (d->point == 0 && d->digit[0] < 5)) && exponent > -FAR) {
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

/* The first of eight bytes whose high bit is set, or 0 where it is not known. */
#if defined(__GNUC__) && defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
#define FIRST_BYTE(w) ((size_t)__builtin_ctzll(w) / 8)
#else
#define FIRST_BYTE(w) 0
#endif

/* The end of the digits at a place; eight bytes at a time. */
static inline size_t digits_end(const char *text, size_t at, size_t size) {
    const uint64_t ones = UINT64_C(0x0101010101010101), high = ones * 0x80;
    while (at < size && size - at >= 8) {
        uint64_t w;
        memcpy(&w, text + at, 8);
        w ^= ones * 0x30; /* a digit is now at most 9 */
        w = (w | ((w & ~high) + ones * 0x76)) & high;
        if (w != 0) {
            at += FIRST_BYTE(w);
            break;
        }
        at += 8;
    }
    while (at < size && text[at] >= '0' && text[at] <= '9') {
        at++;
    }
    return at < size ? at : size;
}

/* Pass a JSON number at a place; `point` is 1 where it has a decimal point or an exponent. Returns the
   place behind it, or 0 if there is none. */
static inline uint32_t number_end(const char *text, uint32_t place, uint32_t size, int *point) {
    size_t at = place, from;
    *point = 0;
    if (at < size) { /* few branches: the bytes of numbers are hard to predict */
        at += text[at] == '-';
    }
    if (at >= size || text[at] < '0' || text[at] > '9') {
        return 0;
    }
    from = at + 1;
    at = digits_end(text, from, size);
    at = text[from - 1] == '0' ? from : at;
    if (at + 1 < size && text[at] == '.' && text[at + 1] >= '0' && text[at + 1] <= '9') {
        *point = 1;
        at = digits_end(text, at + 2, size);
    }
    if (at < size && (text[at] == 'e' || text[at] == 'E')) {
        from = at + 1;
        if (from < size && (text[from] == '+' || text[from] == '-')) {
            from++;
        }
        if (from < size && text[from] >= '0' && text[from] <= '9') {
            *point = 1;
            at = digits_end(text, from + 1, size);
        }
    }
    return (uint32_t)at;
}

/* The exponent of a JSON number, whose `e` is at a place. With more than 17 digits it is less than it
   says, but greater than what a text has room for. */
static int64_t exponent_of(const char *text, uint32_t at, uint32_t end) {
    int64_t n = 0;
    int minus = 0;
    at++;
    if (at < end && (text[at] == '+' || text[at] == '-')) {
        minus = text[at] == '-';
        at++;
    }
    for (; at < end; at++) {
        if (n < INT64_C(100000000000000000)) {
            n = n * 10 + DIGIT(text[at]);
        }
    }
    return minus ? -n : n;
}

/* The decimal that a JSON number between two places writes. */
static void read_decimal(const char *text, uint32_t at, uint32_t end, decimal *d) {
    uint32_t first = NONE, dot = NONE;
    int64_t point;
    memset(d, 0, sizeof *d);
    at += text[at] == '-';
    for (; at < end && text[at] != 'e' && text[at] != 'E'; at++) {
        uint8_t digit = DIGIT(text[at]);
        if (text[at] == '.') {
            dot = at;
        } else if (d->count != 0 || digit != 0) {
            first = first < at ? first : at;
            if (d->count < DIGITS) {
                d->digit[d->count++] = digit;
            } else {
                d->truncated |= digit != 0;
            }
        }
    }
    dot = dot < at ? dot : at;
    point = (int64_t)dot - (int64_t)first + (first < dot ? 0 : 1) + exponent_of(text, at, end);
    d->point = point > FAR ? FAR : point < -FAR ? -FAR : (int)point;
    trim(d);
}

#define MOST_SIZE 320U /* of the digits of a double */

/* The digits of a double with more than 64 bits; `to` has room for MOST_SIZE. Returns their number. */
static uint32_t digits_of(double value, char *to) {
    decimal d;
    uint64_t bits, mantissa;
    int exponent, i;
    uint32_t size = 0;
    memcpy(&bits, &value, sizeof bits);
    mantissa = (bits & ((UINT64_C(1) << 52) - 1)) | UINT64_C(1) << 52;
    exponent = (int)((bits >> 52) & 0x7FFU) - 1075;
    memset(&d, 0, sizeof d);
    for (i = 15; i >= 0; i--) {
        d.digit[i] = (uint8_t)(mantissa % 10);
        mantissa /= 10;
    }
    d.count = 16;
    d.point = 16;
    trim(&d);
    while (exponent > 0 && d.point < FAR) {
        int step = exponent > 59 ? 59 : exponent;
        shift_left(&d, step);
        exponent -= step;
    }
    if (value < 0) {
        to[size++] = '-';
    }
    for (i = 0; i < d.point && size < MOST_SIZE; i++) {
        to[size++] = (char)('0' + (i < (int)count_of(&d) ? d.digit[i] : 0));
    }
    return size;
}

/* The value of the JSON number between two places. A BIG that a decimal point or an exponent writes
   has no digits: `digits`, if not NULL, has room for MOST_SIZE of them. */
static rvaft_value read_number(const char *text, uint32_t at, uint32_t end, int point, char *digits) {
    static const double powers[23] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                      1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
    const uint32_t start = at;
    rvaft_value v;
    uint64_t n = 0;
    int minus = text[at] == '-';
    at += minus != 0;
    if (!point) {
        uint32_t size = end - at;
        if (size > 19) {
            return bytes_of(RVAFT_BIG, text + start, end - start);
        }
        for (; at < end; at++) {
            n = n * 10 + DIGIT(text[at]);
        }
        if (size == 19 && n > (uint64_t)INT64_MAX + (uint64_t)minus) {
            return bytes_of(RVAFT_BIG, text + start, end - start);
        }
        v = integer((int64_t)(minus ? 0U - n : n));
    } else {
        uint32_t dot = NONE;
        int significant = 0;
        int64_t power = 0;
        double d;
        for (; at < end && text[at] != 'e' && text[at] != 'E' && significant <= 15; at++) {
            if (text[at] == '.') {
                dot = at;
            } else {
                n = n * 10 + DIGIT(text[at]);
                significant += n != 0;
            }
        }
        if (significant <= 15) {
            power = exponent_of(text, at, end) - (dot < at ? (int64_t)(at - dot) - 1 : 0);
        }
        if (significant <= 15 && power >= -22 && power <= 22) {
            d = power < 0 ? (double)n / powers[-power] : (double)n * powers[power];
        } else {
            decimal exact;
            read_decimal(text, start, end, &exact);
            d = nearest(&exact);
        }
        d = minus ? -d : d;
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
    if (v.tag != RVAFT_TEXT || v.size == 0 || number_end(v.text, 0, v.size, &point) != v.size) {
        return plain(RVAFT_UNDEFINED);
    }
    if (!point && v.size - (v.text[0] == '-') > MOST_DIGITS) {
        return plain(RVAFT_UNDEFINED);
    }
    v = read_number(v.text, 0, v.size, point, NULL);
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

RVAFT_UNUSED static rvaft_value time_of(const rvaft_event *e) { return e->has_time ? integer(e->time) : plain(RVAFT_UNDEFINED); }

#if RVAFT_NAMED
RVAFT_UNUSED static rvaft_value value_of(const rvaft_monitor *m, const cell *c) {
    rvaft_value v = plain(c->tag);
    if (c->tag == RVAFT_INTEGER) {
        v.integer = c->bits;
    } else if (c->tag == RVAFT_REAL) {
        memcpy(&v.real, &c->bits, sizeof v.real);
    } else if (c->tag >= RVAFT_BIG) {
        uint32_t start;
        if (c->bits < 0 || c->bits >= (int64_t)RVAFT_TEXTS) {
            return plain(RVAFT_UNDEFINED); /* never */
        }
        start = m->texts.start[c->bits];
        v.text = m->texts.bytes + (start < RVAFT_TEXT_BYTES ? start : 0); /* of an empty text at the end, any place */
        v.size = m->texts.size[c->bits];
    }
    return v;
}

#define OLD(n) value_of(m, &old[n])
#endif
#define E(n) (e->field[n])
#define AT time_of(e)

/* @tables */

/* An index is compared with the size of its array also where it is always in bounds: a static analysis
   of this file then proves that no access is wrong. */
#define ROW(table, n) table[(n) < sizeof(table) / sizeof((table)[0]) ? (n) : 0]

#define FEW 63U /* the least mask of buckets */

/* Whether there are eight bytes at a place of some. */
#define HAS_EIGHT(at, size) ((at) < (size) && (size) - (at) >= 8)

RVAFT_UNUSED static uint32_t mixed(uint64_t h) {
    h ^= h >> 32;
    h *= UINT64_C(0xD6E8FEB86659FD93);
    h ^= h >> 29;
    return (uint32_t)(h ^ h >> 32);
}

RVAFT_UNUSED static uint32_t hash_bytes(uint64_t h, const char *text, uint32_t size) {
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

#if RVAFT_KEYED
static int forget_keys(rvaft_monitor *m, uint32_t most);
#endif

#if RVAFT_NAMED

/* Interned texts: each text that is kept is stored once. */

static uint32_t *text_bucket(pool *t, uint32_t hash) { return &t->head[hash & t->mask & (RVAFT_BUCKETS - 1)]; }

/* Note that a value is in use. */
static void mark_text(pool *t, const cell *c) {
    if (c->tag >= RVAFT_BIG && c->bits >= 0 && c->bits < (int64_t)RVAFT_TEXTS) {
        t->live[c->bits] = 1;
    }
}

/* @marks */
/* Link all texts: those in use in their buckets, the others as free. */
static void relink_texts(pool *t) {
    uint32_t i;
    t->spare = NONE;
    for (i = 0; i <= t->mask && i < RVAFT_BUCKETS; i++) {
        t->head[i] = NONE;
    }
    for (i = t->count < RVAFT_TEXTS ? t->count : RVAFT_TEXTS; i > 0; i--) {
        uint32_t *first = t->size[i - 1] == NONE ? &t->spare : text_bucket(t, t->hash[i - 1]);
        t->next[i - 1] = *first;
        *first = i - 1;
    }
}

/* Whether a stored text has these bytes. */
static int has_bytes(const pool *t, uint32_t number, const char *text, uint32_t size) {
    uint32_t at = t->start[number], k = 0;
    if (t->size[number] != size) {
        return 0;
    }
    for (; k + 8 <= size && HAS_EIGHT(at, RVAFT_TEXT_BYTES); k += 8, at += 8) {
        uint64_t ours, theirs;
        memcpy(&ours, t->bytes + at, 8);
        memcpy(&theirs, text + k, 8);
        if (ours != theirs) {
            return 0;
        }
    }
    for (; k < size && at < RVAFT_TEXT_BYTES; k++, at++) {
        if (t->bytes[at] != text[k]) {
            return 0;
        }
    }
    return k == size;
}

/* Write the number of a text, behind which its bytes are put; there is room for both. */
static uint32_t begin_text(pool *t, uint32_t number, uint32_t size) {
    uint32_t at = t->used;
    if (at + sizeof number <= RVAFT_TEXT_BYTES) {
        memcpy(t->bytes + at, &number, sizeof number);
        at += (uint32_t)sizeof number;
    }
    t->start[number] = at;
    t->size[number] = size;
    return at;
}

/* Remove the texts that are not kept. Bytes move, so the texts are moved in their order. */
static void collect_texts(rvaft_monitor *m) {
    pool *t = &m->texts;
    uint32_t from = 0, stop = t->used;
    mark_texts(m);
    t->used = 0;
    while (from < stop && from + sizeof(uint32_t) <= RVAFT_TEXT_BYTES) { /* each text is preceded by its number */
        uint32_t number, size;
        memcpy(&number, t->bytes + from, sizeof number);
        from += (uint32_t)sizeof number;
        if (number >= RVAFT_TEXTS) {
            m->error = RVAFT_FULL; /* never */
            return;
        }
        size = t->size[number];
        if (t->live[number]) {
            uint32_t to = begin_text(t, number, size), end = from + size;
            for (; from < end && from < RVAFT_TEXT_BYTES && to < RVAFT_TEXT_BYTES; from++, to++) {
                t->bytes[to] = t->bytes[from];
            }
            t->used = to;
        } else {
            t->size[number] = NONE;
            from += size;
        }
    }
    relink_texts(t);
}

static int has_room(const pool *t, uint32_t size) {
    return (t->spare != NONE || t->count < RVAFT_TEXTS) && size <= RVAFT_TEXT_BYTES - sizeof(uint32_t) &&
           t->used <= RVAFT_TEXT_BYTES - sizeof(uint32_t) - size;
}

/* The number of a text, or NONE if it is not stored (with `insert`: if there is no room). */
static uint32_t interned(rvaft_monitor *m, const rvaft_value *v, uint32_t hash, int insert) {
    pool *t = &m->texts;
    uint32_t i = *text_bucket(t, hash), at, k;
    for (; i < RVAFT_TEXTS; i = t->next[i]) {
        if (t->hash[i] == hash && has_bytes(t, i, v->text, v->size)) {
            return i;
        }
    }
    if (!insert) {
        return NONE;
    }
    if (!has_room(t, v->size)) {
        collect_texts(m);
#if RVAFT_KEYED
        if (!has_room(t, v->size) && forget_keys(m, RVAFT_KEYS)) {
            collect_texts(m);
        }
#endif
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
    if (i < RVAFT_TEXTS) {
        t->spare = t->next[i];
    } else {
        i = t->count;
        if (i >= RVAFT_TEXTS) {
            m->error = RVAFT_FULL;
            return NONE;
        }
        t->count = i + 1;
    }
    at = begin_text(t, i, v->size);
    for (k = 0; k < v->size && at < RVAFT_TEXT_BYTES; k++, at++) {
        t->bytes[at] = v->text[k];
    }
    t->used = at;
    t->hash[i] = hash;
    t->next[i] = *text_bucket(t, hash);
    *text_bucket(t, hash) = i;
    return i;
}

/* The cell of a field of the event. Without `insert` an unknown text has the number -1. */
static const cell *cell_of(rvaft_monitor *m, const rvaft_event *e, uint32_t field, int insert) {
    cell *c = &ROW(m->cells, field);
    const rvaft_value *v = &ROW(e->field, field);
    if (ROW(m->known, field) == 2 || (ROW(m->known, field) == 1 && !insert)) {
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
        ROW(m->known, field) = 2;
    } else {
        uint32_t number;
        if (v->text == NULL) { /* a double of more than 64 bits */
            m->error = RVAFT_UNSUPPORTED;
            return c;
        }
        c->hash = hash_bytes(m->seed, v->text, v->size);
        number = interned(m, v, c->hash, insert);
        c->bits = number == NONE ? -1 : (int64_t)number;
        ROW(m->known, field) = number == NONE ? 1 : 2;
    }
    return c;
}

#endif

/* How late events may be, or 0. */
RVAFT_UNUSED static uint64_t lateness(void) { return RVAFT_LATE < 0 ? 0 : (uint64_t)RVAFT_LATE; }

/* @events */
/* @kept */
/* @matches */
/* @steps */
/* @follow */
/*@ requires \valid(m) && \valid_read(e) && \separated(m, e);
    assigns m->latest, m->has_latest;
    ensures \result != 0 ==> m->latest == \old(m->latest) > e->time;
    ensures \old(m->has_latest) != 0 ==> m->has_latest != 0 && m->latest >= \old(m->latest); */
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

/* @begin */
/* Start a monitor again after a detection (with keys, that of the last event); times are not forgotten. With
   RVAFT_BY, the matches that have the detected value of a variable have been removed, and others go on. */
RVAFT_API void rvaft_again(rvaft_monitor *m) {
    m->verdict = RVAFT_UNKNOWN;
#if RVAFT_KEYED
    if (m->key < RVAFT_KEYS) {
        m->keys.item[m->key].verdict = RVAFT_UNKNOWN;
    }
#elif !RVAFT_BY
    begin(m);
#endif
}

/* Initialise a monitor in memory that is zero. */
static void init_zeros(rvaft_monitor *m, uint64_t seed) {
    m->seed = seed;
#if RVAFT_NAMED
    m->texts.mask = FEW;
    relink_texts(&m->texts);
#endif
#if RVAFT_KEYED
    m->key = NONE;
    m->keys.spare = NONE;
    memset(m->keys.head, 0xFF, sizeof m->keys.head);
#endif
    begin(m);
}

/* Initialise a monitor. The seed protects against texts chosen to have equal hashes. */
RVAFT_API void rvaft_init(rvaft_monitor *m, uint64_t seed) {
    memset(m, 0, sizeof *m);
    init_zeros(m, seed);
}

/*@ predicate sound(rvaft_monitor *m) = m->verdict \in {RVAFT_UNKNOWN, RVAFT_TRUE, RVAFT_FALSE} &&
        m->error \in {0, RVAFT_FULL, RVAFT_UNSUPPORTED};
    logic integer outcome(rvaft_monitor *m) = m->error != 0 ? m->error : m->verdict; */

/* Note a verdict, but not after an error. */
/*@ requires \valid(m) && verdict \in {RVAFT_UNKNOWN, RVAFT_TRUE, RVAFT_FALSE};
    assigns m->verdict, m->error;
    ensures sound(m) && \result == outcome(m);
    ensures \old(m->error) != 0 ==> \result < 0 && m->verdict == RVAFT_UNKNOWN; */
static int decided(rvaft_monitor *m, int verdict) {
    if (m->error != 0) {
        m->verdict = RVAFT_UNKNOWN;
        m->error = m->error == RVAFT_UNSUPPORTED ? RVAFT_UNSUPPORTED : RVAFT_FULL;
        return m->error;
    }
    m->verdict = verdict;
    return verdict;
}

/*@ requires \valid(m) && \valid_read(e) && \separated(m, e) && sound(m);
    assigns *m;
    ensures sound(m) && \result == outcome(m);
    behavior final:
        assumes outcome(m) != RVAFT_UNKNOWN;
        assigns \nothing;
        ensures \result == \old(outcome(m)); */
static int step(rvaft_monitor *m, const rvaft_event *e) {
    int late;
    uint32_t i;
    if (m->error != 0) {
        return m->error;
    }
    if (m->verdict != RVAFT_UNKNOWN) {
        return m->verdict;
    }
    /*@ loop invariant 0 <= i <= RVAFT_FIELDS;
        loop assigns i, m->known[0 .. RVAFT_FIELDS - 1];
        loop variant RVAFT_FIELDS - i; */
    for (i = 0; i < RVAFT_FIELDS; i++) {
        if (e->field[i].tag == RVAFT_BIG && e->field[i].text == NULL) { /* a double of more than 64 bits */
            m->error = RVAFT_UNSUPPORTED;
            return m->error;
        }
        m->known[i] = 0;
    }
    late = is_late(m, e);
    return decided(m, follow(m, e, late));
}

#if RVAFT_KEYED

#define KEY_NUMBER ((uint32_t)sizeof(uint32_t))

/* Append bytes of a key to those behind all keys; returns 0 if there is no room. */
static int append_key(key_table *t, uint32_t *size, const void *from, uint32_t more) {
    const char *bytes = from;
    uint32_t at = t->used + KEY_NUMBER + *size, i = 0;
    for (; i + 8 <= more && HAS_EIGHT(at, RVAFT_KEY_BYTES); i += 8, at += 8) {
        memcpy(t->bytes + at, bytes + i, 8);
    }
    for (; i < more && at < RVAFT_KEY_BYTES; i++, at++) {
        t->bytes[at] = bytes[i];
    }
    *size += i;
    return i == more;
}

/* The hash of the bytes behind all keys. */
static uint32_t hash_key(const key_table *t, uint64_t h, uint32_t size) {
    uint32_t at = t->used + KEY_NUMBER, i = 0;
    h ^= size;
    for (; i + 8 <= size && HAS_EIGHT(at, RVAFT_KEY_BYTES); i += 8, at += 8) {
        uint64_t part;
        memcpy(&part, t->bytes + at, 8);
        h = (h ^ part) * UINT64_C(0x9E3779B97F4A7C15);
        h ^= h >> 31;
    }
    for (; i < size && at < RVAFT_KEY_BYTES; i++, at++) {
        h = (h ^ (unsigned char)t->bytes[at]) * UINT64_C(0x100000001B3);
        h ^= h >> 29;
    }
    return mixed(h);
}

/* Whether the bytes of a key are those behind all keys. */
static int same_key(const key_table *t, const key_state *k) {
    uint32_t at = t->used + KEY_NUMBER, own = k->start, i = 0;
    for (; i + 8 <= k->size && HAS_EIGHT(at, RVAFT_KEY_BYTES) && HAS_EIGHT(own, RVAFT_KEY_BYTES); i += 8, at += 8, own += 8) {
        uint64_t ours, theirs;
        memcpy(&ours, t->bytes + own, 8);
        memcpy(&theirs, t->bytes + at, 8);
        if (ours != theirs) {
            return 0;
        }
    }
    for (; i < k->size && at < RVAFT_KEY_BYTES && own < RVAFT_KEY_BYTES; i++, at++, own++) {
        if (t->bytes[at] != t->bytes[own]) {
            return 0;
        }
    }
    return i == k->size;
}

/* Append the values of a key of an event, of which equal ones have equal bytes. Returns their number, or NONE
   if it lacks a field or is not finite, or with an error in m->error. */
static uint32_t append_values(rvaft_monitor *m, const rvaft_event *e) {
    key_table *t = &m->keys;
    uint32_t i, size = 0;
    for (i = 0; i < RVAFT_KEY_FIELDS; i++) {
        const rvaft_value *v = &e->field[key_fields[i][0]];
        char tag;
        int good;
        v = v->tag == RVAFT_ABSENT ? &e->field[key_fields[i][1]] : v;
        if (!is_defined(v)) {
            return NONE;
        }
        tag = (char)v->tag;
        good = append_key(t, &size, &tag, 1);
        if (v->tag == RVAFT_INTEGER) {
            good = good && append_key(t, &size, &v->integer, sizeof v->integer);
        } else if (v->tag == RVAFT_REAL) {
            good = good && append_key(t, &size, &v->real, sizeof v->real);
        } else if (v->tag >= RVAFT_BIG) {
            if (v->text == NULL) { /* a double of more than 64 bits */
                m->error = RVAFT_UNSUPPORTED;
                return NONE;
            }
            good = good && append_key(t, &size, &v->size, sizeof v->size) && append_key(t, &size, v->text, v->size);
        }
        if (!good) {
            m->error = RVAFT_FULL;
            return NONE;
        }
    }
    return size;
}

/* Move the bytes of the keys that are live together. */
static void gather_keys(key_table *t) {
    uint32_t from = 0, to = 0;
    while (from < t->used && from <= RVAFT_KEY_BYTES - KEY_NUMBER) {
        uint32_t number, end;
        memcpy(&number, t->bytes + from, sizeof number);
        end = from + KEY_NUMBER + ROW(t->item, number).size;
        if (ROW(t->live, number)) {
            ROW(t->item, number).start = to + KEY_NUMBER;
            for (; from < end && from < RVAFT_KEY_BYTES && to < RVAFT_KEY_BYTES; from++, to++) {
                t->bytes[to] = t->bytes[from];
            }
        }
        from = end;
    }
    t->used = to;
}

/* Forget the keys that have detected nothing and of which no event matters any more, by the greatest time of all
   keys and twice the lateness, if at most some keys are then left; returns whether it is so. */
static int forget_keys(rvaft_monitor *m, uint32_t most) {
    key_table *t = &m->keys;
    uint32_t i, home, kept = 0;
    const uint64_t before = t->forgotten;
    int64_t horizon;
    int some = 0;
    if (RVAFT_LATE < 0 || t->lasts) {
        return 0;
    }
    for (i = 0; i < t->count && i < RVAFT_KEYS; i++) {
        const key_state *k = &t->item[i];
        if (t->birth[i] != 0 && k->has_latest && (!some || t->newest < k->latest)) {
            t->newest = k->latest;
            some = 1;
        }
    }
    if (!some) {
        return 0;
    }
    memset(t->live, 0, sizeof t->live);
    mark_keys(m);
    for (i = 0; i < t->count && i < RVAFT_KEYS; i++) {
        const key_state *k = &t->item[i];
        t->live[i] = t->birth[i] != 0 && (t->live[i] || k->found || i == m->key);
        kept += t->live[i];
    }
    if (kept > most) {
        return 0;
    }
    gather_keys(t);
    memset(t->head, 0xFF, sizeof t->head);
    t->spare = NONE;
    for (i = 0; i < t->count && i < RVAFT_KEYS; i++) {
        key_state *k = &t->item[i];
        if (t->live[i]) {
            home = k->hash % RVAFT_KEYS;
            k->next = t->head[home];
            t->head[home] = i;
        } else {
            t->forgotten += t->birth[i] != 0;
            t->birth[i] = 0;
            k->era++;
            k->has_latest = 0;
            k->next = t->spare;
            t->spare = i;
        }
    }
    horizon = t->newest < INT64_MIN + (int64_t)lateness() ? INT64_MIN : t->newest - (int64_t)lateness();
    t->horizon = before == 0 || horizon > t->horizon ? horizon : t->horizon;
    t->kept = kept;
    return 1;
}

/* A new key of the values behind all keys, or NONE if there is no room. */
static uint32_t new_key(rvaft_monitor *m, const rvaft_event *e, uint32_t size, uint32_t hash) {
    key_table *t = &m->keys;
    uint32_t i = t->spare, home = hash % RVAFT_KEYS;
    key_state *k;
    if (i < RVAFT_KEYS) {
        t->spare = t->item[i].next;
    } else if (t->count < RVAFT_KEYS) {
        i = t->count++;
    } else {
        return NONE;
    }
    k = &t->item[i];
    if (t->used <= RVAFT_KEY_BYTES - KEY_NUMBER) { /* always */
        memcpy(t->bytes + t->used, &i, KEY_NUMBER);
    }
    k->latest = 0;
    k->has_latest = 0;
    k->verdict = RVAFT_UNKNOWN;
    k->found = 0;
    k->hash = hash;
    k->size = size;
    k->start = t->used + KEY_NUMBER;
    k->next = t->head[home];
    t->head[home] = i;
    t->used += KEY_NUMBER + size;
    t->kept++;
    t->births++;
    t->birth[i] = t->births;
    if (t->forgotten != 0 && e->has_time && e->time < t->horizon) {
        t->early++;
#if RVAFT_PLACES
        m->first_early = m->first_early != 0 ? m->first_early : e->at.number;
#endif
    }
    return i;
}

/* The number of the key of an event, or NONE if it has none, or with an error in m->error. */
static uint32_t key_of(rvaft_monitor *m, const rvaft_event *e) {
    key_table *t = &m->keys;
    int again;
    m->key = NONE;
    for (again = 0; again < 2; again++) { /* the second time after keys were forgotten */
        uint32_t size = append_values(m, e), hash, i;
        if (size == NONE && m->error != RVAFT_FULL) {
            return NONE;
        }
        if (size != NONE && t->used <= RVAFT_KEY_BYTES - KEY_NUMBER - size) {
            hash = hash_key(t, m->seed, size);
            for (i = t->head[hash % RVAFT_KEYS]; i < RVAFT_KEYS; i = t->item[i].next) {
                const key_state *k = &t->item[i];
                if (k->hash == hash && k->size == size && same_key(t, k)) {
                    return i;
                }
            }
            i = new_key(m, e, size, hash);
            if (i < RVAFT_KEYS) {
                return i;
            }
        }
        m->error = 0;
        if (!forget_keys(m, (uint32_t)((uint64_t)RVAFT_KEYS * 9 / 10))) {
            break;
        }
    }
    m->error = RVAFT_FULL;
    t->full = 1;
    return NONE;
}

/* Take over the state of the key of an event; 0 if it has none, or on an error. */
static int enter_key(rvaft_monitor *m, const rvaft_event *e) {
    const key_state *k;
    m->verdict = RVAFT_UNKNOWN;
    m->key = m->error == 0 ? key_of(m, e) : NONE;
    if (m->key >= RVAFT_KEYS) {
        return 0;
    }
    k = &m->keys.item[m->key];
    m->latest = k->latest;
    m->has_latest = k->has_latest;
    m->verdict = k->verdict;
    return 1;
}

static void leave_key(rvaft_monitor *m) {
    key_state *k = &ROW(m->keys.item, m->key);
    k->latest = m->latest;
    k->has_latest = m->has_latest;
#if !RVAFT_BY
    k->era += m->verdict != k->verdict;
#endif
    k->verdict = m->verdict;
    k->found |= m->verdict != RVAFT_UNKNOWN;
}

#endif

/* Read an event. Returns the verdict (with keys, that of its key), or an error, after which the
   monitor must not be used. */
/*@ requires \valid(m) && \valid_read(e) && \separated(m, e) && sound(m);
    assigns *m;
    ensures sound(m) && \result == outcome(m);
    behavior final:
        assumes outcome(m) != RVAFT_UNKNOWN;
        ensures \result == \old(outcome(m)); */
RVAFT_API int rvaft_step(rvaft_monitor *m, const rvaft_event *e) {
    int before, verdict;
    m->changed = 0;
#if RVAFT_KEYED
    if (!enter_key(m, e)) {
        return m->error;
    }
#endif
    before = m->verdict;
    verdict = step(m, e);
#if RVAFT_KEYED
    leave_key(m);
#endif
    m->changed = verdict != before;
    return verdict;
}

#if !RVAFT_KEYED

/* A time in nanoseconds has come, without an event. Returns the verdict or an error as rvaft_step does. */
RVAFT_API int rvaft_pass_time(rvaft_monitor *m, int64_t time) {
    m->changed = 0;
    if (m->error != 0 || m->verdict != RVAFT_UNKNOWN) {
        return m->error != 0 ? m->error : m->verdict;
    }
    if (RVAFT_LATE >= 0 && (!m->has_latest || time > m->latest)) {
        m->latest = time;
        m->has_latest = 1;
    }
#if RVAFT_WAITS
    m->changed = is_decided(m, time);
#endif
    return decided(m, m->changed ? RVAFT_TRUE : RVAFT_UNKNOWN);
}

/* The trace has ended, so that no event breaks a match that waits. Returns as rvaft_step does. */
RVAFT_API int rvaft_finish(rvaft_monitor *m) {
    m->changed = 0;
    if (m->error != 0 || m->verdict != RVAFT_UNKNOWN) {
        return m->error != 0 ? m->error : m->verdict;
    }
#if RVAFT_WAITS
    m->changed = is_whole(m);
#endif
    return decided(m, m->changed ? RVAFT_TRUE : RVAFT_UNKNOWN);
}

#endif

/* @bytes */
/* @state */
