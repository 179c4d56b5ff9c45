#pragma once
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
typedef int esp_err_t;
#define ESP_OK 0
#define ESP_FAIL -1
const char *esp_err_to_name(esp_err_t code);
#define ESP_ERROR_CHECK(call)                                                                                \
    do {                                                                                                     \
        esp_err_t code_ = (call);                                                                            \
        if (code_ != ESP_OK)                                                                                 \
            abort();                                                                                         \
    } while (0)
