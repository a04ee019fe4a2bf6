#define _POSIX_C_SOURCE 200809L
#include "vendor_line.h"

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define LINE_MAX_BYTES 1024

double vendor_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void vendor_sleep(double seconds)
{
    struct timespec pause;
    if (!(seconds > 0.0))
        return;
    pause.tv_sec = (time_t)seconds;
    pause.tv_nsec = (long)((seconds - (double)pause.tv_sec) * 1e9);
    nanosleep(&pause, NULL);
}

int vendor_address(const char *text, struct sockaddr_in *address)
{
    char host[64];
    const char *colon = strrchr(text, ':');
    char *end;
    long port;
    if (colon == NULL || (size_t)(colon - text) >= sizeof host)
        return 0;
    memcpy(host, text, (size_t)(colon - text));
    host[colon - text] = '\0';
    port = strtol(colon + 1, &end, 10);
    if (*end != '\0' || port < 0 || port > 65535)
        return 0;
    memset(address, 0, sizeof *address);
    address->sin_family = AF_INET;
    address->sin_port = htons((uint16_t)port);
    return inet_pton(AF_INET, host, &address->sin_addr) == 1;
}

static int opened(const struct sockaddr_in *address,
                  int (*call)(int, const struct sockaddr *, socklen_t))
{
    int own = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (own >= 0 && call(own, (const struct sockaddr *)address, sizeof *address) != 0) {
        int error = errno;
        close(own);
        errno = error;
        return -1;
    }
    return own;
}

int vendor_listen(const struct sockaddr_in *address)
{
    return opened(address, bind);
}

int vendor_connect(const struct sockaddr_in *address)
{
    return opened(address, connect);
}

void vendor_begin(vendor_line *line, const char *word, unsigned long long number)
{
    memset(line, 0, sizeof *line);
    snprintf(line->word, sizeof line->word, "%s", word);
    line->number = number;
}

/* Writes the name of a value: a kind and, unless it is 0, a number. */
static void name_of(char name[16], const char *kind, int number)
{
    if (number == 0)
        snprintf(name, 16, "%.15s", kind);
    else
        snprintf(name, 16, "%.4s%d", kind, number % 1000);
}

void vendor_add(vendor_line *line, const char *kind, int number, double value)
{
    vendor_pair *pair;
    if (line->count >= VENDOR_PAIRS_MAX || !isfinite(value))
        return;
    pair = &line->pairs[line->count++];
    name_of(pair->name, kind, number);
    pair->value = value;
}

double vendor_value(const vendor_line *line, const char *kind, int number)
{
    char name[16];
    int place;
    name_of(name, kind, number);
    for (place = 0; place < line->count; place++)
        if (strcmp(line->pairs[place].name, name) == 0)
            return line->pairs[place].value;
    return NAN;
}

/* CRC-32 as in IEEE 802.3. */
static uint32_t crc32(const char *bytes, size_t size)
{
    uint32_t crc = 0xffffffffu;
    size_t place;
    int bit;
    for (place = 0; place < size; place++) {
        crc ^= (uint8_t)bytes[place];
        for (bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

int vendor_send(int socket, const vendor_line *line, const struct sockaddr_in *to)
{
    char text[LINE_MAX_BYTES];
    size_t size = (size_t)snprintf(text, sizeof text, "%s %llu", line->word, line->number);
    int place;
    for (place = 0; place < line->count && size < sizeof text; place++)
        size += (size_t)snprintf(text + size, sizeof text - size, " %s=%.17g",
                                 line->pairs[place].name, line->pairs[place].value);
    if (size + 10 > sizeof text) {
        errno = EMSGSIZE;
        return -1;
    }
    size += (size_t)snprintf(text + size, sizeof text - size, "#%08x", crc32(text, size));
    if (sendto(socket, text, size, 0, (const struct sockaddr *)to, to ? sizeof *to : 0) < 0)
        return -1;
    return 0;
}

/* Reads a line that ends at its NUL; returns 0 if it is none. */
static int parsed(char *text, vendor_line *line)
{
    char *check = strrchr(text, '#');
    char *next, *word, *end;
    char expected[16];
    if (check == NULL)
        return 0;
    snprintf(expected, sizeof expected, "#%08x", crc32(text, (size_t)(check - text)));
    if (strcmp(check, expected) != 0)
        return 0;
    *check = '\0';
    word = strtok_r(text, " ", &next);
    if (word == NULL || strlen(word) >= sizeof line->word)
        return 0;
    vendor_begin(line, word, 0);
    word = strtok_r(NULL, " ", &next);
    if (word == NULL || *word < '0' || *word > '9')
        return 0;
    line->number = strtoull(word, &end, 10);
    if (*end != '\0')
        return 0;
    while ((word = strtok_r(NULL, " ", &next)) != NULL) {
        vendor_pair *pair = &line->pairs[line->count];
        char *equals = strchr(word, '=');
        if (line->count >= VENDOR_PAIRS_MAX || equals == NULL || equals == word)
            return 0;
        *equals = '\0';
        if (strlen(word) >= sizeof pair->name)
            return 0;
        strcpy(pair->name, word);
        pair->value = strtod(equals + 1, &end);
        if (end == equals + 1 || *end != '\0' || !isfinite(pair->value))
            return 0;
        line->count++;
    }
    return 1;
}

int vendor_receive(int socket, double seconds, vendor_line *line, struct sockaddr_in *from)
{
    char text[LINE_MAX_BYTES];
    socklen_t length = sizeof *from;
    ssize_t size;
    int flags = MSG_DONTWAIT;
    if (seconds >= 1e-6) {
        struct timeval wait;
        wait.tv_sec = (time_t)seconds;
        wait.tv_usec = (suseconds_t)((seconds - (double)wait.tv_sec) * 1e6);
        /* 0 would wait for ever. */
        if (wait.tv_sec == 0 && wait.tv_usec == 0)
            wait.tv_usec = 1;
        if (setsockopt(socket, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof wait) != 0)
            return -1;
        flags = 0;
    }
    size = recvfrom(socket, text, sizeof text - 1, flags, (struct sockaddr *)from, &length);
    if (size < 0)
        return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? 0 : -1;
    text[size] = '\0';
    return parsed(text, line) ? 1 : 2;
}
