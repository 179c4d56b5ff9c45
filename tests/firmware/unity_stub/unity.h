/* As much of Unity as esp32_firmware/test needs, so that its tests also run where PlatformIO cannot fetch
 * Unity. */
#pragma once
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
void setUp(void);
void tearDown(void);
#define TEST_ASSERT_TRUE(condition)                                                                          \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition);                                           \
            exit(1);                                                                                         \
        }                                                                                                    \
    } while (0)
#define TEST_ASSERT_EQUAL_UINT(expected, actual)                                                             \
    TEST_ASSERT_TRUE((unsigned long)(expected) == (unsigned long)(actual))
#define TEST_ASSERT_EQUAL_MEMORY(expected, actual, n) TEST_ASSERT_TRUE(memcmp(expected, actual, n) == 0)
#define UNITY_BEGIN() ((void)0)
#define UNITY_END() 0
#define RUN_TEST(test)                                                                                       \
    do {                                                                                                     \
        setUp();                                                                                             \
        test();                                                                                              \
        tearDown();                                                                                          \
        puts("passed " #test);                                                                               \
    } while (0)
