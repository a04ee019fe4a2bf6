#include "line_channels.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int32_t refuse(const rcc_channel *channel, const char *text, rcc_error *error)
{
    snprintf(error->at, sizeof error->at, "%s", channel->name);
    snprintf(error->text, sizeof error->text, "the device has no channel %.64s%s", channel->address, text);
    return RCC_REFUSED;
}

int32_t line_channels_read(line_channels *channels, const rcc_device *device, rcc_error *error)
{
    uint32_t place;
    memset(channels, 0, sizeof *channels);
    for (place = 0; place < RCC_ANALOG_MAX; place++)
        channels->released.analog[place] = NAN;
    memset(channels->released.digital, -1, sizeof channels->released.digital);
    for (place = 0; place < device->channel_count; place++) {
        const rcc_channel *channel = &device->channels[place];
        line_channel *own = &channels->all[channels->count];
        char *end;
        long number = strtol(channel->address, &end, 10);
        if (end == channel->address || *end != '\0' || number < 1 || number > 16)
            return refuse(channel, "", error);
        if (channels->count == LINE_CHANNELS_MAX)
            return refuse(channel, ": it has too many", error);
        own->kind = channel->kind;
        own->index = channel->index;
        own->number = (int)number;
        channels->count++;
        if (channel->kind == RCC_DIGITAL_OUTPUT && !isnan(channel->released))
            channels->released.digital[channel->index] = channel->released != 0.0;
        if (channel->kind == RCC_ANALOG_OUTPUT)
            channels->released.analog[channel->index] = channel->released;
    }
    return RCC_OK;
}

void line_channels_write(const line_channels *channels, const rcc_outputs *outputs, vendor_line *line)
{
    uint32_t place;
    for (place = 0; place < channels->count; place++) {
        const line_channel *own = &channels->all[place];
        if (own->kind == RCC_DIGITAL_OUTPUT && outputs->digital[own->index] >= 0)
            vendor_add(line, "d", own->number, outputs->digital[own->index]);
        if (own->kind == RCC_ANALOG_OUTPUT && !isnan(outputs->analog[own->index]))
            vendor_add(line, "a", own->number, outputs->analog[own->index]);
    }
}

int line_channels_inputs(const line_channels *channels, const vendor_line *line, rcc_inputs *inputs)
{
    uint32_t place;
    for (place = 0; place < channels->count; place++) {
        const line_channel *own = &channels->all[place];
        double value;
        if (own->kind == RCC_DIGITAL_INPUT) {
            value = vendor_value(line, "d", own->number);
            inputs->digital[own->index] = value != 0.0;
        } else if (own->kind == RCC_ANALOG_INPUT) {
            value = vendor_value(line, "a", own->number);
            inputs->analog[own->index] = value;
        } else {
            continue;
        }
        if (isnan(value))
            return 0;
    }
    return 1;
}
