/* The loop around the radio core: carries events, bytes, frames and memory between it and the chip. Whatever
 * could be decided otherwise is decided in the core. */
#ifndef SHELL_H
#define SHELL_H

#include "hal_event.h"
#include "hal_host.h"
#include "radio_core.h"

/* host has been started, and so have the board, ESP-NOW and the alarm clock, which post into events. */
void shell_start(const rc_config *config, QueueHandle_t events, const hal_host *host);
/* Waits for an event, a millisecond at most, and does all that there is to do. */
void shell_step(void);

#endif
