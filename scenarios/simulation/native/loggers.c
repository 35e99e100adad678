/* Loggers with FMI 2.0's variable arguments: each formats its lines and passes them to a function of its own. */
#include "stepper.h"

#include <stdarg.h>
#include <stdio.h>

enum { LOGGERS = 64, LINE = 2048 };

static LogLine receivers[LOGGERS];

static void pass_on(size_t number, int status, const char *message, va_list arguments)
{
    char line[LINE] = "";
    if (receivers[number] == NULL)
        return;
    if (message != NULL)
        vsnprintf(line, sizeof line, message, arguments);
    receivers[number](status, line);
}

#define LOGGER(number)                                                                                                 \
    static void logger_##number(void *environment, const char *instance, int status, const char *category,             \
                                const char *message, ...)                                                              \
    {                                                                                                                  \
        va_list arguments;                                                                                             \
        (void)environment;                                                                                             \
        (void)instance;                                                                                                \
        (void)category;                                                                                                \
        va_start(arguments, message);                                                                                  \
        pass_on(0##number, status, message, arguments);                                                                \
        va_end(arguments);                                                                                             \
    }
#define EIGHT(use, tens)                                                                                               \
    use(tens##0) use(tens##1) use(tens##2) use(tens##3) use(tens##4) use(tens##5) use(tens##6) use(tens##7)
/* Octal numbers, 00 to 77 */
#define ALL(use)                                                                                                       \
    EIGHT(use, 0) EIGHT(use, 1) EIGHT(use, 2) EIGHT(use, 3) EIGHT(use, 4) EIGHT(use, 5) EIGHT(use, 6) EIGHT(use, 7)

ALL(LOGGER)

#define ENTRY(number) logger_##number,
static const Logger loggers[LOGGERS] = {ALL(ENTRY)};

Logger take_logger(LogLine receiver)
{
    for (size_t k = 0; k < LOGGERS; k++)
        if (receivers[k] == NULL) {
            receivers[k] = receiver;
            return loggers[k];
        }
    return NULL;
}

void release_logger(Logger logger)
{
    for (size_t k = 0; k < LOGGERS; k++)
        if (loggers[k] == logger)
            receivers[k] = NULL;
}
