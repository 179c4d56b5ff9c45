#pragma once
#include <stdint.h>
#include <stdlib.h>
typedef int BaseType_t;
typedef unsigned UBaseType_t;
typedef uint32_t TickType_t;
typedef uint8_t StackType_t;
typedef struct {
    void *room[24];
} StaticTask_t;
typedef struct {
    void *room[24];
} StaticQueue_t;
#define pdFALSE 0
#define pdTRUE 1
#define pdPASS 1
#define configMAX_PRIORITIES 25
#define pdMS_TO_TICKS(ms) ((TickType_t)(ms))
