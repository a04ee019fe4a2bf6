/* The channels of both drivers: outputs into a line, a line into inputs. Their addresses are numbers from 1 to 16. */
#ifndef LINE_CHANNELS_H
#define LINE_CHANNELS_H

#include "rcc_driver.h"
#include "vendor_line.h"

#define LINE_CHANNELS_MAX 64
#define LINE_ADDRESS "a number from 1 to 16"

typedef struct line_channel {
    int32_t kind;
    uint32_t index;
    int number;
} line_channel;

typedef struct line_channels {
    line_channel all[LINE_CHANNELS_MAX];
    uint32_t count;
    rcc_outputs released; /* the outputs that no net commands */
} line_channels;

/* Copies what is needed of the device's channels; returns RCC_REFUSED and names the channel whose address is wrong. */
int32_t line_channels_read(line_channels *channels, const rcc_device *device, rcc_error *error);
/* Adds the outputs that have a value. */
void line_channels_write(const line_channels *channels, const rcc_outputs *outputs, vendor_line *line);
/* Returns 0 if an input is missing in the line. */
int line_channels_inputs(const line_channels *channels, const vendor_line *line, rcc_inputs *inputs);

#endif
