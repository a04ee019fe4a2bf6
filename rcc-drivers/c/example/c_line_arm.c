/* The program of the arm's driver. */
#include "line_drivers.h"

int main(void)
{
    return rcc_driver_main(&line_arm);
}
