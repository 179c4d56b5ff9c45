/* The button and the LED of the board. Which pins: -DHIPPOMAT_BUTTON_PIN, -DHIPPOMAT_LED_PIN (-1: none) and
 * -DHIPPOMAT_LED_RGB (1: one WS2812, 0: a plain LED, lit by a high level). */
#ifndef HAL_BOARD_H
#define HAL_BOARD_H

#include "esp_err.h"
#include "lamp.h"

/* What fails is left out: neither is worth a radio. */
void hal_board_start(void);
bool hal_board_pressed(void);
void hal_board_show(lamp_light light);

#endif
