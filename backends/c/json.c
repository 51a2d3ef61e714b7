#if RVAFT_JSON

/* JSON: a scanner that validates a line and reads the fields of the tree. The byte after the line is
   no part of JSON (a newline), and eight more can be read. */

#define MAX_DEPTH 500
#define MEMBERS 4096

typedef struct member {
    size_t value; /* its place in the line */
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
    int odd; /* whether a number of the line is not finite */
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
    if (at > r->size || r->size - at < 4) {
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

/* The first place that is not a plain character of a string; before it are only such. */
static inline size_t plain_end(const char *text, size_t at, size_t size) {
    const uint64_t ones = UINT64_C(0x0101010101010101), high = ones * 0x80;
    while (at < size && size - at >= 8) {
        uint64_t w, quote, slash;
        memcpy(&w, text + at, 8);
        quote = w ^ (ones * 0x22);
        slash = w ^ (ones * 0x5C);
        w = (w | (w - ones * 0x20) | ((quote - ones) & ~quote) | ((slash - ones) & ~slash)) & high;
        if (w != 0) {
            return at + FIRST_BYTE(w);
        }
        at += 8;
    }
    return at;
}

/* Pass the rest of a string from a place; notes whether it has escapes. */
static int scan_rest(rvaft_reader *r, size_t at, int *escaped) {
    for (;;) {
        unsigned char c;
        at = plain_end(r->text, at, r->size);
        if (at >= r->size) {
            r->at = r->size;
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

/* Pass a string whose quote is behind `at`; notes whether it has escapes. */
static inline int scan_string(rvaft_reader *r, int *escaped) {
    size_t at = plain_end(r->text, r->at, r->size);
    *escaped = 0;
    if (at < r->size && r->text[at] == '"') {
        r->at = at + 1;
        return 0;
    }
    return scan_rest(r, at, escaped);
}

static int put(rvaft_reader *r, uint32_t c) {
    if (r->used >= RVAFT_SCRATCH) {
        return full(r, "the texts of an event");
    }
    r->scratch[r->used++] = (char)(unsigned char)c;
    return 0;
}

/* Decode a valid string between two places into scratch. */
static int decode(rvaft_reader *r, size_t at, size_t end) {
    while (at < end && at < r->size) {
        uint32_t c = (unsigned char)r->text[at++];
        int error = 0;
        if (c != '\\') {
            error = put(r, c);
        } else {
            c = at < r->size ? (unsigned char)r->text[at] : '\\';
            at++;
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

static inline void skip_blanks(rvaft_reader *r) {
    size_t at = r->at;
    while (at < r->size && (unsigned char)r->text[at] <= 0x20U &&
           (r->text[at] == ' ' || r->text[at] == '\t' || r->text[at] == '\r' || r->text[at] == '\n')) {
        at++;
    }
    r->at = at;
}

/* Go on by so many bytes, at most to the end. */
static inline void advance(rvaft_reader *r, size_t size) {
    r->at = size < r->size - r->at ? r->at + size : r->size;
}

static int is_word(const rvaft_reader *r, const char *word, size_t size) {
    return r->at < r->size && size <= r->size - r->at && memcmp(r->text + r->at, word, size) == 0;
}

/* Pass a value that is no string, list or object; `v` may be NULL. */
static int scan_scalar(rvaft_reader *r, rvaft_value *v) {
    static const struct {
        const char *word;
        uint32_t size;
        uint32_t tag;
    } words[6] = {{"true", 4, RVAFT_YES},      {"false", 5, RVAFT_NO},          {"null", 4, RVAFT_NULL},
                  {"NaN", 3, RVAFT_UNDEFINED}, {"Infinity", 8, RVAFT_UNDEFINED}, {"-Infinity", 9, RVAFT_UNDEFINED}};
    const char *text;
    uint32_t start, end, size, i;
    int point;
    char c = r->at < r->size ? r->text[r->at] : '\n';
    if ((c < '0' || c > '9') && c != '-') {
        for (i = 0; i < 5; i++) {
            if (is_word(r, words[i].word, words[i].size)) {
                advance(r, words[i].size);
                r->odd |= i >= 3;
                if (v != NULL) {
                    *v = plain(words[i].tag);
                }
                return 0;
            }
        }
        return refused(r, "expecting value");
    }
    text = r->text;
    end = number_end(text, (uint32_t)r->at, (uint32_t)r->size, &point);
    if (end == 0) {
        if (is_word(r, words[5].word, words[5].size)) {
            advance(r, words[5].size);
            r->odd = 1;
            if (v != NULL) {
                *v = plain(words[5].tag);
            }
            return 0;
        }
        return refused(r, "expecting value");
    }
    start = (uint32_t)r->at;
    size = end - start;
    if (!point && size - (c == '-') > MOST_DIGITS) {
        return refused(r, "a number of more than 4300 digits");
    }
    r->at = end;
    if (v != NULL) {
        int room = point && RVAFT_SCRATCH >= MOST_SIZE && r->used <= RVAFT_SCRATCH - MOST_SIZE;
        *v = read_number(text, start, end, point, room ? r->scratch + r->used : NULL);
        if (v->tag != RVAFT_BIG) { /* as written, for times */
            v->text = text + start;
            v->size = size;
        } else if (v->text == NULL) {
            return full(r, "the texts of an event");
        } else if (room && v->size <= MOST_SIZE) {
            uint32_t used = r->used + v->size;
            r->used = used < RVAFT_SCRATCH ? used : RVAFT_SCRATCH;
        }
    }
    return 0;
}

/* Whether a number, and not -Infinity, is at `r->at`. */
static int starts_number(const rvaft_reader *r) {
    size_t at = r->at < r->size ? r->at + (r->text[r->at] == '-') : r->size;
    return at < r->size && r->text[at] >= '0' && r->text[at] <= '9';
}

/* Pass a value, which is valid JSON and in an object, up to the comma or the bracket behind it. */
static void pass_value(rvaft_reader *r) {
    uint32_t depth = 0;
    int escaped;
    while (r->at < r->size) {
        char c = r->text[r->at];
        if (depth == 0 && (c == ',' || c == '}')) {
            return;
        }
        r->at++;
        if (c == '"') {
            (void)scan_string(r, &escaped);
        } else if (c == '{' || c == '[') {
            depth++;
        } else if (c == '}' || c == ']') {
            depth--;
        }
    }
}

/* The byte at `r->at`, or a newline behind the line. */
static char byte_at(const rvaft_reader *r) { return r->at < r->size ? r->text[r->at] : '\n'; }

static void pass_comma(rvaft_reader *r) {
    skip_blanks(r);
    advance(r, byte_at(r) == ',');
    skip_blanks(r);
}

/* Append bytes to scratch. */
static int put_bytes(rvaft_reader *r, const void *from, uint32_t size) {
    const char *bytes = from;
    uint32_t i;
    int error = 0;
    for (i = 0; i < size && !error; i++) {
        error = put(r, (unsigned char)bytes[i]);
    }
    return error;
}

/* Append bytes that are in scratch already. */
static int put_again(rvaft_reader *r, uint32_t at, uint32_t size) {
    int error = 0;
    for (; size > 0 && at < RVAFT_SCRATCH && !error; size--, at++) {
        error = put(r, (unsigned char)r->scratch[at]);
    }
    return error;
}

/* Begin a value with its tag and four bytes for a size. */
static int put_head(rvaft_reader *r, uint32_t tag) { return put(r, tag) || put_bytes(r, "size", 4); }

/* Write the size of the value that begins at a place in scratch, which has its end at `r->used`. */
static void put_size(rvaft_reader *r, uint32_t at) {
    uint32_t size = r->used - at, i;
    for (i = 1; i < 5 && at + i < RVAFT_SCRATCH; i++) {
        r->scratch[at + i] = (char)(unsigned char)(size & 0xFFU);
        size >>= 8;
    }
}

/* The order of two keys in scratch. */
static int order_of(const rvaft_reader *r, const member *a, const member *b) {
    uint32_t i = a->key, k = b->key, left = a->size < b->size ? a->size : b->size;
    for (; left > 0 && i < RVAFT_SCRATCH && k < RVAFT_SCRATCH; left--, i++, k++) {
        if (r->scratch[i] != r->scratch[k]) {
            return (unsigned char)r->scratch[i] < (unsigned char)r->scratch[k] ? -1 : 1;
        }
    }
    return a->size < b->size ? -1 : a->size > b->size;
}

/* Note the fields of the object at `r->at` behind those in `r->members`, in order. */
static int note_members(rvaft_reader *r) {
    uint32_t first = r->members, count = first, k;
    int escaped;
    advance(r, 1);
    skip_blanks(r);
    while (r->at < r->size && byte_at(r) != '}') {
        member made;
        size_t from = r->at + 1;
        advance(r, 1);
        if (count >= MEMBERS) {
            return full(r, "the fields of an object");
        }
        made.key = r->used;
        if (scan_string(r, &escaped) || decode(r, from, r->at - 1)) {
            return RVAFT_FULL;
        }
        made.size = r->used - made.key;
        skip_blanks(r);
        advance(r, 1);
        made.value = r->at;
        for (k = count; k > first && k < MEMBERS; k--) { /* few fields: insertion sort */
            member other;
            int order = order_of(r, &r->member[k - 1], &made);
            if (order == 0) {
                return refused(r, "a key is repeated");
            }
            if (order < 0) {
                break;
            }
            other = r->member[k - 1];
            r->member[k] = other;
        }
        r->member[k < MEMBERS ? k : 0] = made;
        count++;
        pass_value(r);
        pass_comma(r);
    }
    r->members = count;
    advance(r, 1);
    return 0;
}

/* Write the canonical form of the value at `r->at`, which is valid JSON: equal values have equal
   bytes. Sets `undefined` where a number is not finite. */
/*@ requires r->used <= RVAFT_SCRATCH;
    requires r->members <= MEMBERS;
    assigns r->at, r->used, r->members, r->reason, r->odd, r->member[0 .. MEMBERS - 1], r->scratch[0 .. RVAFT_SCRATCH - 1],
            *undefined;
    ensures r->used <= RVAFT_SCRATCH;
    ensures r->members <= MEMBERS; */
static int canonical(rvaft_reader *r, int *undefined) {
    int error = 0, escaped;
    uint32_t begin = r->used, i;
    size_t from;
    char c;
    rvaft_value v = {NULL, 0.0, 0, 0, 0};
    skip_blanks(r);
    from = r->at;
    c = byte_at(r);
    if (c == '"') {
        advance(r, 1);
        error = put_head(r, '"') || scan_string(r, &escaped) || decode(r, from + 1, r->at - 1);
        put_size(r, begin);
        return error ? RVAFT_FULL : 0;
    }
    if (c == '[') {
        error = put(r, '[');
        advance(r, 1);
        skip_blanks(r);
        while (!error && r->at < r->size && byte_at(r) != ']') {
            error = canonical(r, undefined);
            pass_comma(r);
        }
        advance(r, 1);
        return error ? error : put(r, ']');
    }
    if (c == '{') {
        uint32_t first = r->members, start;
        size_t end;
        error = note_members(r);
        end = r->at;
        start = r->used; /* behind the keys, over which the object then moves */
        error = error ? error : put(r, '{');
        for (i = first; !error && i < r->members && i < MEMBERS; i++) {
            const member one = r->member[i];
            error = put_bytes(r, &one.size, 4) || put_again(r, one.key, one.size) ? RVAFT_FULL : 0;
            r->at = one.value < r->size ? one.value : r->size;
            error = error ? error : canonical(r, undefined);
        }
        r->members = first;
        r->at = end < r->size ? end : r->size;
        error = error ? error : put(r, '}');
        for (i = start; i < r->used && i < RVAFT_SCRATCH && begin < RVAFT_SCRATCH; i++, begin++) {
            r->scratch[begin] = r->scratch[i];
        }
        r->used = begin;
        return error;
    }
    error = put_head(r, '#') ? RVAFT_FULL : scan_scalar(r, &v);
    *undefined |= v.tag == RVAFT_UNDEFINED;
    if (error) {
        return error;
    }
    if (v.tag == RVAFT_BIG && r->used == begin + 5) { /* else the scanner wrote its digits */
        for (; from < r->at && from < r->size && !error; from++) {
            error = put(r, (unsigned char)r->text[from]);
        }
    } else if (v.tag == RVAFT_INTEGER) {
        error = put_bytes(r, &v.integer, 8);
    } else if (v.tag == RVAFT_REAL) {
        error = put_bytes(r, &v.real, 8);
    }
    put_size(r, begin);
    return error ? RVAFT_FULL : put(r, 'a' + v.tag);
}

#define KEY_HASH(first, size) ((5U * (size) + (unsigned char)(first)) % 64U)

/* The node for a key below a node, or -1; the key is at a place of a text of `limit` bytes. */
static inline int32_t child_of(int32_t node, const char *text, size_t at, uint32_t size, size_t limit) {
    int below = node >= 0 && node < RVAFT_FIELDS;
    int32_t child = node < -1 ? FIRST_FIELD : below ? fields[node].child : -1;
    uint64_t keys = node < -1 ? FIRST_KEYS : below ? fields[node].keys : 0;
    char first = size > 0 && at < limit ? text[at] : '\0';
    if ((keys >> KEY_HASH(first, size) & 1U) == 0) {
        return -1;
    }
    while (child >= 0 && child < RVAFT_FIELDS) {
        const field_node *f = &fields[child];
        if (f->size == size && f->name != NULL && size <= limit && at <= limit - size &&
            (size == 0 || (f->name[0] == first && memcmp(f->name, text + at, size) == 0))) {
            return child;
        }
        child = f->next;
    }
    return -1;
}

static int32_t item_of(int32_t node, uint32_t item) {
    int32_t child = node >= 0 && node < RVAFT_FIELDS ? fields[node].child : -1;
    while (child >= 0 && child < RVAFT_FIELDS) {
        if (fields[child].name == NULL && fields[child].size == item) {
            return child;
        }
        child = fields[child].next;
    }
    return -1;
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
    r->odd = 0;
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
            advance(r, 1);
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
            size_t start = r->at + 1;
            r->at = start;
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
            size_t start = r->at;
            int time = node >= 0 && ROW(fields, (uint32_t)node).time && starts_number(r);
            error = scan_scalar(r, node >= 0 && !time ? &e->field[node] : NULL);
            if (error) {
                return error;
            }
            if (node >= 0 && time) {
                e->field[node] = bytes_of(RVAFT_REAL, r->text + start, (uint32_t)(r->at - start));
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
                advance(r, 1);
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
            advance(r, 1);
            depth--;
            if (f->node >= 0 && f->node < RVAFT_FIELDS) {
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
                node = child_of(f->node, r->scratch, used, r->used - used, RVAFT_SCRATCH);
                r->used = used;
            } else {
                node = child_of(f->node, r->text, start, (uint32_t)(r->at - 1 - start), r->size);
            }
            if (node >= 0 && e->field[node].tag != RVAFT_ABSENT) {
                return refused(r, "a key is repeated");
            }
        }
        skip_blanks(r);
        if (r->at >= r->size || r->text[r->at] != ':') {
            return refused(r, "expecting ':' delimiter");
        }
        advance(r, 1);
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

#define SHORT INT64_C(900000000000000000) /* ten times as much, and a digit, fit in 64 bits */

/* The nanoseconds of a decimal number in units of 10^scale; returns 0 unless it is short and needs no rounding. */
static int short_time(const char *text, uint32_t size, int scale, int64_t *time) {
    uint32_t at = text[0] == '-', dot = size;
    int64_t n = 0;
    if (size > 20) {
        return 0;
    }
    for (; at < size && n < SHORT; at++) {
        if (text[at] == '.') {
            dot = at + 1;
        } else if (text[at] >= '0' && text[at] <= '9') {
            n = n * 10 + DIGIT(text[at]);
        } else {
            return 0; /* an exponent */
        }
    }
    for (; dot < size && scale > -FAR; dot++) {
        scale--;
    }
    for (; scale > 0 && n < SHORT; scale--) {
        n *= 10;
    }
    if (at < size || scale != 0) {
        return 0;
    }
    *time = text[0] == '-' ? -n : n;
    return 1;
}

/* A decimal number of units of 10^scale nanoseconds, half to even: 1, 0 if undefined, or an error. */
RVAFT_UNUSED static int decimal_time(const rvaft_value *v, int scale, int64_t *time) {
    decimal d;
    uint64_t n;
    int point;
    int minus;
    if (v->tag == RVAFT_TEXT ? v->size == 0 || v->size > 1000 || number_end(v->text, 0, v->size, &point) != v->size
                             : !is_number(v) || v->text == NULL) {
        return 0;
    }
    if (short_time(v->text, v->size, scale, time)) {
        return 1;
    }
    minus = v->text[0] == '-';
    read_decimal(v->text, 0, v->size, &d);
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
    int found, minus, left, error = 0;
    int64_t rest;
    uint64_t part, ticks = 0;
    uint32_t i;
    rvaft_value t;
    decimal d;
    found = decimal_time(v, -40, &rest);
    if (found != 1) {
        return found;
    }
    read_decimal(v->text, 0, v->size, &d);
    if (d.point > 18) {
        return RVAFT_UNSUPPORTED;
    }
    for (i = 0; (int)i < d.point && i < 18; i++) { /* apart: with two more digits it may need more than 64 bits */
        ticks = ticks * 10 + (i < d.count ? d.digit[i] : 0U);
    }
    left = (int)count_of(&d) - (int)i;
    d.count = left > 0 ? (uint32_t)left : 0;
    memmove(d.digit, d.digit + i, d.count);
    d.point = d.point > 0 ? 2 : d.point + 2;
    part = rounded(&d);
    minus = v->text[0] == '-';
    t = subtract(&error, integer((int64_t)(minus ? 0U - ticks : ticks)), integer(INT64_C(116444736000000000)));
    t = multiply(&error, t, integer(100));
    t = add(&error, t, integer((int64_t)(minus ? 0U - part : part)));
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
    int hours = 0, minutes = 0, sign = text[at] == '-' ? -1 : 1;
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

/* The nanoseconds that decimals of a second between two places write, half to even. */
static int64_t decimals_of(const char *text, uint32_t at, uint32_t end) {
    decimal d;
    read_decimal(text, at, end, &d);
    if (d.count == 0) {
        return 0;
    }
    for (; at < end && d.point > -FAR; at++) {
        d.point--;
    }
    d.point += 9;
    return (int64_t)rounded(&d);
}

RVAFT_UNUSED static int iso_time(const rvaft_value *v, int64_t *time) {
    const char *t = v->text;
    uint32_t at = 16, size = v->size;
    int century = 0, year = 0, month = 0, day = 0, hour = 0, minute = 0, second = 0, ahead = 0;
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
            at = (uint32_t)digits_end(t, from, size);
            rest = decimals_of(t, from, at);
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

#endif
