/* A driver for an I/O box: each period the box is asked, answers, and gets the outputs. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "line_channels.h"
#include "line_drivers.h"

enum { SETTING_BOX, SETTING_PERIOD, SETTING_TIMEOUT };

static const rcc_setting SETTINGS[] = {
    {"box", RCC_ADDRESS, NULL, "an address with a port, such as \"127.0.0.1:7000\""},
    {"period", RCC_DURATION, "10 ms", "a time with its unit, such as \"10 ms\""},
    {"timeout", RCC_DURATION, "20 ms", "a time with its unit, such as \"20 ms\""},
};

typedef struct line_box_state {
    int socket;
    double period_s, timeout_s, silence_max_s;
    double next_s;        /* when the next period starts */
    double last_answer_s; /* after silence_max_s without one, the box gets the released outputs */
    unsigned long long number;
    uint64_t late, refused;
    line_channels channels;
} line_box_state;

static int32_t failed(const char *text, rcc_error *error)
{
    snprintf(error->text, sizeof error->text, "%s: %s", text, strerror(errno));
    return RCC_FAILED;
}

static int32_t box_open(const rcc_device *device, void **state, rcc_error *error)
{
    struct sockaddr_in box;
    line_box_state *own = calloc(1, sizeof *own);
    int32_t result;
    if (own == NULL)
        return failed("no memory", error);
    own->socket = -1;
    result = line_channels_read(&own->channels, device, error);
    if (result == RCC_OK) {
        snprintf(error->at, sizeof error->at, "%s", SETTINGS[SETTING_BOX].key);
        if (!vendor_address(device->settings[SETTING_BOX].text, &box)) {
            snprintf(error->text, sizeof error->text, "not an address of IPv4");
            result = RCC_REFUSED;
        } else if ((own->socket = vendor_connect(&box)) < 0) {
            result = failed("no socket for the box", error);
        }
    }
    if (result != RCC_OK) {
        free(own);
        return result;
    }
    own->period_s = device->settings[SETTING_PERIOD].number;
    own->timeout_s = device->settings[SETTING_TIMEOUT].number;
    own->silence_max_s = fmax(device->command_timeout_s, 5.0 * own->period_s);
    own->next_s = own->last_answer_s = vendor_now();
    *state = own;
    return RCC_OK;
}

/* Waits for the start of a period; returns the periods since the last one, or 0 if none started. */
static uint64_t wait_period(line_box_state *own, double timeout_s)
{
    double now_s = vendor_now(), left_s = own->next_s - now_s;
    uint64_t ticks;
    vendor_sleep(fmin(left_s, timeout_s));
    if (left_s > timeout_s)
        return 0;
    now_s = fmax(vendor_now(), own->next_s);
    /* A late period is skipped, never caught up with. */
    ticks = (uint64_t)floor((now_s - own->next_s) / own->period_s) + 1;
    own->next_s += (double)ticks * own->period_s;
    return ticks;
}

static int32_t box_send(void *state, const rcc_outputs *outputs, rcc_error *error)
{
    line_box_state *own = state;
    vendor_line line;
    vendor_begin(&line, "set", own->number - 1);
    line_channels_write(&own->channels, outputs, &line);
    if (vendor_send(own->socket, &line, NULL) != 0)
        return failed("the box cannot be reached", error);
    return RCC_OK;
}

static int32_t box_receive(void *state, double timeout_s, rcc_inputs *inputs, rcc_exchange *exchange, rcc_error *error)
{
    line_box_state *own = state;
    uint64_t ticks = wait_period(own, timeout_s);
    double deadline_s;
    vendor_line line;
    struct sockaddr_in from;
    if (ticks == 0)
        return RCC_SILENT;
    vendor_begin(&line, "get", own->number++);
    if (vendor_send(own->socket, &line, NULL) != 0)
        return failed("the box cannot be reached", error);
    deadline_s = vendor_now() + own->timeout_s;
    for (;;) {
        double left_s = deadline_s - vendor_now();
        int received = left_s > 0.0 ? vendor_receive(own->socket, left_s, &line, &from) : 0;
        if (received < 0)
            return failed("the box cannot be reached", error);
        if (received == 0)
            break;
        if (received == 1 && strcmp(line.word, "is") == 0 && line.number + 1 == own->number
            && line_channels_inputs(&own->channels, &line, inputs)) {
            own->last_answer_s = vendor_now();
            exchange->period_s = own->period_s;
            exchange->ticks = ticks;
            exchange->late = own->late;
            exchange->refused = own->refused;
            return RCC_OK;
        }
        own->refused++;
    }
    own->late++;
    /* The box may hear us although its answers are lost: the host does not answer a silent device. */
    if (vendor_now() - own->last_answer_s > own->silence_max_s)
        return box_send(own, &own->channels.released, error) == RCC_OK ? RCC_SILENT : RCC_FAILED;
    return RCC_SILENT;
}

static void box_close(void *state)
{
    line_box_state *own = state;
    close(own->socket);
    free(own);
}

const rcc_driver line_box = {
    .version = RCC_DRIVER_VERSION,
    .has_arm = 0,
    .name = "c-line-io",
    .address = LINE_ADDRESS,
    .settings = SETTINGS,
    .setting_count = sizeof SETTINGS / sizeof *SETTINGS,
    .open = box_open,
    .receive = box_receive,
    .send = box_send,
    .close = box_close,
};
