#pragma once
#include <stdio.h>
#define ESP_LOGE(tag, format, ...) printf("log %s: " format "\n", tag __VA_OPT__(, ) __VA_ARGS__)
#define ESP_LOGW ESP_LOGE
#define ESP_LOGI ESP_LOGE
