/* The drivers of this folder. */
#ifndef LINE_DRIVERS_H
#define LINE_DRIVERS_H

#include "rcc_driver.h"

extern const rcc_driver line_box;
extern const rcc_driver line_arm;

#endif
