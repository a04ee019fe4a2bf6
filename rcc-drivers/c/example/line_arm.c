/*
 * A driver for the controller of an arm, which sends its state first and is answered with set-points. Until it follows them
 * (go=1), each answer repeats its own position.
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "line_channels.h"
#include "line_drivers.h"

enum { SETTING_LISTEN, SETTING_PERIOD };

static const rcc_setting SETTINGS[] = {
    {"listen", RCC_ADDRESS, NULL, "an address with a port, such as \"127.0.0.1:7001\""},
    {"period", RCC_DURATION, "4 ms", "a time with its unit, such as \"4 ms\""},
};

enum { REASON_HOLDING = 200, REASON_REJOINED = 201, REASON_RELEASED = 202 };

static const rcc_reason REASONS[] = {
    {REASON_HOLDING, "the controller holds the arm and follows no set-points: it begins when it is answered in time"},
    {REASON_REJOINED, "the controller is in the middle of a motion that this driver did not begin: it gets no answer and brakes"},
    {REASON_RELEASED, "the driver has released the arm and is ending"},
};

/* After this silence the controller may have been restarted, s. */
#define SILENCE_MAX_S 0.2
/* Most datagrams that are read at once. */
#define BURST_MAX 64

typedef struct line_arm_state {
    int socket;
    uint32_t joints;
    double period_s;
    double last_line_s;
    struct sockaddr_in controller;
    int has_controller;
    vendor_line line; /* the newest one; number 0: none */
    int began;        /* what the controller follows began here */
    int released;
    uint64_t refused;
    line_channels channels;
} line_arm_state;

static int32_t failed(const char *text, rcc_error *error)
{
    snprintf(error->text, sizeof error->text, "%s: %s", text, strerror(errno));
    return RCC_FAILED;
}

static int32_t arm_open(const rcc_device *device, void **state, rcc_error *error)
{
    struct sockaddr_in listen;
    line_arm_state *own = calloc(1, sizeof *own);
    int32_t result;
    if (own == NULL)
        return failed("no memory", error);
    result = line_channels_read(&own->channels, device, error);
    if (result == RCC_OK) {
        snprintf(error->at, sizeof error->at, "%s", SETTINGS[SETTING_LISTEN].key);
        if (!vendor_address(device->settings[SETTING_LISTEN].text, &listen)) {
            snprintf(error->text, sizeof error->text, "not an address of IPv4");
            result = RCC_REFUSED;
        } else if ((own->socket = vendor_listen(&listen)) < 0) {
            result = failed("no socket there", error);
        }
    }
    if (result != RCC_OK) {
        free(own);
        return result;
    }
    own->joints = device->joints;
    own->period_s = device->settings[SETTING_PERIOD].number;
    own->last_line_s = vendor_now();
    *state = own;
    return RCC_OK;
}

static int follows(const line_arm_state *own)
{
    return vendor_value(&own->line, "go", 0) == 1.0;
}

static uint32_t reason_of(const line_arm_state *own)
{
    if (own->released)
        return REASON_RELEASED;
    if (!follows(own))
        return REASON_HOLDING;
    return own->began ? 0 : REASON_REJOINED;
}

/* Returns 1 if this is the controller's next line. */
static int is_next(const line_arm_state *own, const vendor_line *line, const struct sockaddr_in *from)
{
    rcc_inputs unused;
    uint32_t joint;
    if (own->has_controller
        && (from->sin_port != own->controller.sin_port
            || from->sin_addr.s_addr != own->controller.sin_addr.s_addr))
        return 0;
    if (strcmp(line->word, "is") != 0 || line->number <= own->line.number || isnan(vendor_value(line, "go", 0)))
        return 0;
    for (joint = 1; joint <= own->joints; joint++)
        if (isnan(vendor_value(line, "q", (int)joint)))
            return 0;
    return line_channels_inputs(&own->channels, line, &unused);
}

/* Waits for a line and reads what has arrived besides; after a stall of this process only the newest one counts. */
static int32_t newest_line(line_arm_state *own, double timeout_s, rcc_error *error)
{
    double deadline_s = vendor_now() + timeout_s;
    int found = 0, count;
    for (count = 0; count < BURST_MAX; count++) {
        double wait_s = found ? 0.0 : deadline_s - vendor_now();
        struct sockaddr_in from;
        vendor_line line;
        int received = vendor_receive(own->socket, wait_s, &line, &from);
        if (received < 0)
            return failed("the socket failed", error);
        if (received == 0)
            break;
        if (received == 1 && is_next(own, &line, &from)) {
            own->line = line;
            own->controller = from;
            own->has_controller = found = 1;
        } else {
            own->refused++;
        }
    }
    if (found) {
        own->last_line_s = vendor_now();
        return RCC_OK;
    }
    if (vendor_now() - own->last_line_s > SILENCE_MAX_S) {
        own->has_controller = own->began = 0;
        own->line.number = 0;
    }
    return RCC_SILENT;
}

static int32_t arm_receive(void *state, double timeout_s, rcc_inputs *inputs, rcc_exchange *exchange, rcc_error *error)
{
    line_arm_state *own = state;
    unsigned long long before = own->line.number;
    int32_t result = newest_line(own, timeout_s, error);
    uint32_t joint;
    if (result != RCC_OK)
        return result;
    if (!follows(own))
        own->began = 1;
    line_channels_inputs(&own->channels, &own->line, inputs);
    for (joint = 0; joint < own->joints; joint++)
        inputs->position[joint] = vendor_value(&own->line, "q", (int)joint + 1);
    exchange->reason = reason_of(own);
    exchange->commandable = exchange->reason == 0;
    exchange->period_s = own->period_s;
    /* The device's own counter is the clock by which set-points are played. */
    exchange->ticks = before == 0 ? 1 : own->line.number - before;
    exchange->refused = own->refused;
    return RCC_OK;
}

static int32_t arm_send(void *state, const rcc_outputs *outputs, rcc_error *error)
{
    line_arm_state *own = state;
    uint32_t reason = reason_of(own), joint;
    vendor_line line;
    /* Any position would be a jolt: without an answer the controller brakes by its own ramp. */
    if (reason == REASON_REJOINED || own->line.number == 0)
        return RCC_OK;
    vendor_begin(&line, "set", own->line.number);
    for (joint = 0; joint < own->joints; joint++)
        vendor_add(&line, "q", (int)joint + 1,
                   reason == 0 ? outputs->position[joint] : vendor_value(&own->line, "q", (int)joint + 1));
    if (own->released)
        vendor_add(&line, "stop", 0, 1.0);
    line_channels_write(&own->channels, outputs, &line);
    if (vendor_send(own->socket, &line, &own->controller) != 0)
        return failed("the socket failed", error);
    return RCC_OK;
}

static void arm_release(void *state)
{
    line_arm_state *own = state;
    own->released = 1;
}

static void arm_close(void *state)
{
    line_arm_state *own = state;
    close(own->socket);
    free(own);
}

const rcc_driver line_arm = {
    .version = RCC_DRIVER_VERSION,
    .has_arm = 1,
    .name = "c-line-arm",
    .address = LINE_ADDRESS,
    .settings = SETTINGS,
    .reasons = REASONS,
    .setting_count = sizeof SETTINGS / sizeof *SETTINGS,
    .reason_count = sizeof REASONS / sizeof *REASONS,
    .open = arm_open,
    .receive = arm_receive,
    .send = arm_send,
    .release = arm_release,
    .close = arm_close,
};
