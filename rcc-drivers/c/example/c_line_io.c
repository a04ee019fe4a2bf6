/* The program of the I/O box's driver. */
#include "line_drivers.h"

int main(void)
{
    return rcc_driver_main(&line_box);
}
