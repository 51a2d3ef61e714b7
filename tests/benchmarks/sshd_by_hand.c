/* Five failures of an address, then a success, within a minute, for the lines that `logs.sshd` writes.
   Prints the number of detections; after each, the address starts afresh. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SLOTS 65536

struct address {
    char name[16];
    int64_t failures[5];
    int count, next;
};
static struct address table[SLOTS];

static struct address *find(const char *name, size_t length) {
    uint32_t hash = 2166136261u;
    for (size_t i = 0; i < length; i++) hash = (hash ^ (unsigned char)name[i]) * 16777619u;
    struct address *one = &table[hash % SLOTS];
    while (one->name[0] && (strncmp(one->name, name, length) || one->name[length])) {
        if (++one == table + SLOTS) one = table;
    }
    if (!one->name[0]) memcpy(one->name, name, length);
    return one;
}

int main(int argc, char **argv) {
    FILE *log = argc == 2 ? fopen(argv[1], "rb") : NULL;
    if (!log) return 2;
    static char buffer[1 << 20];
    setvbuf(log, buffer, _IOFBF, sizeof buffer);
    char line[4096];
    long detections = 0;
    while (fgets(line, sizeof line, log)) {
        char *after, *event = strstr(line, "\"event\": \"");
        if (!event || (event[10] != 'f' && event[10] != 'a')) continue;
        char *ip = strstr(event, "\"ip\": \"");
        char *end = ip ? strchr(ip + 7, '"') : NULL;
        if (!end || end - (ip + 7) > 15) continue;
        int64_t time = strtoll(line + 9, &after, 10) * 1000 + strtoll(after + 1, NULL, 10);
        struct address *one = find(ip + 7, (size_t)(end - (ip + 7)));
        if (event[10] == 'f') {
            one->failures[one->next] = time;
            one->next = (one->next + 1) % 5;
            if (one->count < 5) one->count++;
        } else if (one->count == 5 && time - one->failures[one->next] <= 60000) {
            one->count = one->next = 0;
            detections++;
        }
    }
    printf("%ld\n", detections);
    return fclose(log) != 0;
}
