/* Tables for the tests: one of another header, one that is incomplete, and a device whose functions give what the test says. */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rcc_driver.h"

const size_t layout[] = {
    sizeof(rcc_error), sizeof(rcc_setting), sizeof(rcc_value), sizeof(rcc_channel), sizeof(rcc_device), sizeof(rcc_inputs),
    sizeof(rcc_exchange), sizeof(rcc_outputs), sizeof(rcc_reason), sizeof(rcc_driver),
    offsetof(rcc_channel, released), offsetof(rcc_device, command_timeout_s), offsetof(rcc_inputs, digital),
    offsetof(rcc_exchange, commandable), offsetof(rcc_outputs, digital), offsetof(rcc_driver, close),
};

const rcc_driver other_version = {.version = RCC_DRIVER_VERSION + 1};
const rcc_driver incomplete = {.version = RCC_DRIVER_VERSION, .name = "incomplete", .address = "none"};

static const rcc_setting SETTINGS[] = {{"fault", RCC_NUMBER, "0", "a number"}};

static int32_t faulty_open(const rcc_device *device, void **state, rcc_error *error)
{
    double *fault = malloc(sizeof *fault);
    *fault = device->settings[0].number;
    if (*fault == 1.0) {
        free(fault);
        memset(error->at, 'x', sizeof error->at); /* without an end */
        memset(error->text, 0xff, sizeof error->text);
        return RCC_FAILED;
    }
    *state = fault;
    return RCC_OK;
}

static int32_t faulty_receive(void *state, double timeout_s, rcc_inputs *inputs, rcc_exchange *exchange, rcc_error *error)
{
    double fault = *(double *)state;
    int joint;
    (void)timeout_s;
    for (joint = 0; joint < RCC_JOINTS_MAX; joint++)
        inputs->position[joint] = 0.25;
    exchange->period_s = 1e-3;
    inputs->digital[0] = 1;
    inputs->analog[0] = 0.5;
    if (fault == 2.0)
        inputs->position[2] = NAN;
    if (fault == 3.0)
        inputs->analog[0] = INFINITY;
    if (fault == 4.0) {
        snprintf(error->text, sizeof error->text, "the fuse is blown");
        return RCC_FAILED;
    }
    if (fault == 5.0)
        return 77;
    if (fault == 6.0)
        memset(inputs, 0x55, sizeof *inputs);
    if (fault == 7.0)
        memset(exchange, 0xff, sizeof *exchange);
    return RCC_OK;
}

static int32_t faulty_send(void *state, const rcc_outputs *outputs, rcc_error *error)
{
    (void)outputs;
    snprintf(error->text, sizeof error->text, "it takes nothing");
    return *(double *)state == 8.0 ? RCC_FAILED : RCC_OK;
}

static void faulty_close(void *state)
{
    free(state);
}

const rcc_driver faulty = {
    .version = RCC_DRIVER_VERSION,
    .has_arm = 1,
    .name = "faulty",
    .address = "anything",
    .settings = SETTINGS,
    .setting_count = 1,
    .open = faulty_open,
    .receive = faulty_receive,
    .send = faulty_send,
    .close = faulty_close,
};
