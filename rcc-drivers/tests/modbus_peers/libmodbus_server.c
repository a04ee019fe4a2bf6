/* A Modbus TCP server made with libmodbus; arguments: port, delay of each answer in ms. It shows in further inputs what
 * the library reads from the registers that were written. Its floats are filled word by word and checked by the library's
 * functions that read: in 3.1.6 those that write swap the bytes of each word on a little-endian machine. */
#include <modbus.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

static void look(modbus_mapping_t *map) {
    uint16_t *from = map->tab_registers, *to = map->tab_input_registers + 100;
    to[0] = (int16_t)(modbus_get_float_abcd(from) * 10);
    to[1] = (int16_t)(modbus_get_float_cdab(from + 2) * 10);
    to[2] = (int16_t)(modbus_get_float_badc(from + 4) * 10);
    to[3] = (int16_t)(modbus_get_float_dcba(from + 6) * 10);
    to[4] = (int16_t)(MODBUS_GET_INT32_FROM_INT16(from, 8) / 1000);
    to[5] = (int16_t)(MODBUS_GET_INT64_FROM_INT16(from, 10) / 1000000000);
    for (int bit = 0; bit < 16; bit++)
        map->tab_input_bits[bit] = map->tab_bits[bit];
}

int main(int count, char **arguments) {
    if (count != 3)
        return 2;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    modbus_t *context = modbus_new_tcp("127.0.0.1", atoi(arguments[1]));
    modbus_mapping_t *map = modbus_mapping_new(100, 100, 200, 200);
    if (!context || !map)
        return 1;
    uint16_t *input = map->tab_input_registers;
    /* 123456.0 is 47F1 2000, -0.15625 is BE20 0000. */
    const uint16_t words[8] = {0x47F1, 0x2000, 0x0000, 0xBE20, 0xF147, 0x0020, 0x0000, 0x20BE};
    memcpy(input, words, sizeof words);
    if (modbus_get_float_abcd(input) != 123456.0f || modbus_get_float_cdab(input + 2) != -0.15625f ||
        modbus_get_float_badc(input + 4) != 123456.0f || modbus_get_float_dcba(input + 6) != -0.15625f)
        return 1;
    MODBUS_SET_INT32_TO_INT16(input, 8, -70000);
    MODBUS_SET_INT64_TO_INT16(input, 10, -5000000000LL);
    input[14] = 65535;
    map->tab_input_bits[20] = 1;
    int listener = modbus_tcp_listen(context, 4);
    if (listener < 0)
        return 1;
    puts("ready");
    fflush(stdout);
    for (;;) {
        uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
        if (modbus_tcp_accept(context, &listener) < 0)
            return 1;
        for (;;) {
            int length = modbus_receive(context, query);
            if (length < 0)
                break;
            if (length == 0)
                continue;
            usleep(1000 * atoi(arguments[2]));
            modbus_reply(context, query, length, map);
            look(map);
        }
        close(modbus_get_socket(context));
    }
}
