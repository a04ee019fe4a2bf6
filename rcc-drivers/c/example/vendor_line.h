/*
 * Stands for a vendor's library, which knows nothing of RCC: lines of text over UDP, each with a checksum.
 *
 *     WORD NUMBER NAME=VALUE … #CRC
 */
#ifndef VENDOR_LINE_H
#define VENDOR_LINE_H

#include <netinet/in.h>

#define VENDOR_PAIRS_MAX 48

typedef struct vendor_pair {
    char name[16];
    double value; /* finite */
} vendor_pair;

typedef struct vendor_line {
    char word[8];
    unsigned long long number;
    int count;
    vendor_pair pairs[VENDOR_PAIRS_MAX];
} vendor_line;

/* Seconds of a clock that only goes forward, and a pause. */
double vendor_now(void);
void vendor_sleep(double seconds);

/* Reads "127.0.0.1:7000"; returns 0 if it is none. */
int vendor_address(const char *text, struct sockaddr_in *address);
/* Return a socket, or -1 and errno. */
int vendor_listen(const struct sockaddr_in *address);
int vendor_connect(const struct sockaddr_in *address);

/* Begins a line; adds a value to it; returns that of a name, or NAN. A name is a kind and, unless it is 0, a number: "q1", "go". */
void vendor_begin(vendor_line *line, const char *word, unsigned long long number);
void vendor_add(vendor_line *line, const char *kind, int number, double value);
double vendor_value(const vendor_line *line, const char *kind, int number);

/* Sends a line, to `to` if the socket is not connected; returns 0, or -1 and errno. */
int vendor_send(int socket, const vendor_line *line, const struct sockaddr_in *to);
/* Waits at most `seconds`; 1: a line; 0: nothing arrived; 2: a datagram that is no line; -1: errno. */
int vendor_receive(int socket, double seconds, vendor_line *line, struct sockaddr_in *from);

#endif
