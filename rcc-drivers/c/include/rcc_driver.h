/*
 * Drivers for RCC in C (C99). A driver is a table of five functions; its program is
 *
 *     int main(void) { return rcc_driver_main(&my_driver); }
 *
 * linked with librcc_driver_c.a. docs/drivers.md explains it; rcc-drivers/c/example has an I/O box and an arm.
 *
 * All functions are called one at a time, open first and close last, and never at the same time by two threads; they may be
 * called by another thread than open was. Only receive may wait. The tables and every text in them must live as long as the
 * program. Bytes from a device are untrusted: check them before you use them.
 */
#ifndef RCC_DRIVER_H
#define RCC_DRIVER_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Of this header; the library refuses a table that was compiled with another one. */
#define RCC_DRIVER_VERSION 1

#define RCC_JOINTS_MAX 8
#define RCC_DIGITAL_MAX 64
#define RCC_ANALOG_MAX 16

/* What a function returns. */
#define RCC_OK 0
#define RCC_REFUSED 1 /* open: the configuration is wrong; error->at names the setting, the channel, or "robot" */
#define RCC_FAILED 2  /* the operating system or the device failed; error->text says how. The device is lost */
#define RCC_SILENT 3  /* receive: nothing arrived within the time-out */

/* Why a function failed, in words for users. Both are empty when the function is called; longer texts are cut. */
typedef struct rcc_error {
    char at[64];
    char text[192];
} rcc_error;

/* A setting of the device in the cell's file. */
enum { RCC_TEXT = 0, RCC_NUMBER = 1, RCC_DURATION = 2, RCC_ADDRESS = 3 };
typedef struct rcc_setting {
    const char *key;
    int32_t form;         /* RCC_TEXT; RCC_NUMBER: finite; RCC_DURATION: "20 ms", greater than 0; RCC_ADDRESS: "127.0.0.1:7000" */
    const char *fallback; /* used if the setting is left out, in the same form; NULL: it must be given */
    const char *expected; /* valid values, for messages: "a time with its unit, such as \"20 ms\"" */
} rcc_setting;

/* The value of a setting: its text, and the number of RCC_NUMBER, or s of RCC_DURATION. */
typedef struct rcc_value {
    const char *text;
    double number;
} rcc_value;

/* A channel of the device. Values on the wire are raw: the library converts between them and SI units. */
enum { RCC_DIGITAL_INPUT = 0, RCC_DIGITAL_OUTPUT = 1, RCC_ANALOG_INPUT = 2, RCC_ANALOG_OUTPUT = 3 };
typedef struct rcc_channel {
    const char *name;
    const char *address; /* as in the cell's file; a number is given as text */
    int32_t kind;
    uint32_t index;      /* its place in rcc_inputs or rcc_outputs, among the channels of its kind */
    double released;     /* of an output, raw: its value when no net commands it; NAN: it keeps its last one */
} rcc_channel;

/* The device as the cell's file configures it. It lives until open returns. */
typedef struct rcc_device {
    const char *name;
    uint32_t joints;             /* of the arm; 0 if the driver has none */
    uint32_t channel_count;
    const rcc_value *settings;   /* in the order of the driver's table */
    const rcc_channel *channels;
    double command_timeout_s;    /* after so long without an answer of the device, its outputs must be released */
} rcc_device;

/* Measured values. Everything is unknown when receive is called: NAN, and -1 for digital inputs. */
typedef struct rcc_inputs {
    double position[RCC_JOINTS_MAX];        /* rad (linear axes: m); must be known if there is an arm */
    double torque[RCC_JOINTS_MAX];          /* N m */
    double external_torque[RCC_JOINTS_MAX]; /* measured torque minus that of the device's model, N m */
    double wrench[6];                       /* fx fy fz tx ty tz at the flange, N and N m: all six, or none */
    double analog[RCC_ANALOG_MAX];          /* raw */
    int8_t digital[RCC_DIGITAL_MAX];        /* 0 or 1 */
} rcc_inputs;

/* What an exchange says besides. When receive is called: commandable and startable, one tick, quality 1000, nothing else. */
typedef struct rcc_exchange {
    double mirror[RCC_JOINTS_MAX]; /* where the arm holds itself while not commandable, rad (linear axes: m); NAN: at its position */
    double period_s;               /* of the device; must be set */
    uint64_t ticks;                /* periods of the device since the last exchange, by its own counter */
    uint64_t late;                 /* answers that the device missed, and datagrams that were refused, since open */
    uint64_t refused;
    uint32_t quality;              /* thousandths */
    uint32_t reason;               /* why no net may start: a number of the driver's table; 0 otherwise */
    int8_t commandable;            /* the device follows set-points now; always 1 for plain I/O */
} rcc_exchange;

/* Values for the device. */
typedef struct rcc_outputs {
    double position[RCC_JOINTS_MAX]; /* set-points, rad (linear axes: m); within the robot's limits */
    double analog[RCC_ANALOG_MAX];   /* raw; NAN: no value, the device keeps its present one */
    int8_t digital[RCC_DIGITAL_MAX]; /* 0 or 1; -1: no value */
} rcc_outputs;

/* What can be wrong with the device, in words for users; numbers begin at 200. */
typedef struct rcc_reason {
    uint32_t number;
    const char *text;
} rcc_reason;

typedef struct rcc_driver {
    uint32_t version;    /* RCC_DRIVER_VERSION */
    uint32_t has_arm;    /* 1: the device needs `robot:`; 0: it must not have one */
    const char *name;    /* of the program */
    const char *address; /* what an address may be, for messages: "a number from 1 to 16" */
    const rcc_setting *settings;
    const rcc_reason *reasons;
    uint32_t setting_count;
    uint32_t reason_count;

    /* Checks and prepares what does not need the device; does not wait. A device that does not answer is no error. */
    int32_t (*open)(const rcc_device *device, void **state, rcc_error *error);
    /* Waits for the device's next cycle, at most timeout_s, and stores what it says. Reaches for a lost device by itself. */
    int32_t (*receive)(void *state, double timeout_s, rcc_inputs *inputs, rcc_exchange *exchange, rcc_error *error);
    /* Answers the exchange; called after each receive that returned RCC_OK. Repeats all outputs, so that a loss is repaired. */
    int32_t (*send)(void *state, const rcc_outputs *outputs, rcc_error *error);
    /* Asks the device to follow set-points no longer: the arm is at rest, and the program is ending. NULL: nothing to do. */
    void (*release)(void *state);
    /* Frees the state. NULL: nothing to do. */
    void (*close)(void *state);
} rcc_driver;

/* The whole program of a driver: reads the arguments of the process, and runs until it is asked to stop. Returns main's result. */
int rcc_driver_main(const rcc_driver *driver);

#ifdef __cplusplus
}
#endif

#endif
