/* The fossil beside this file's header path, as a later SDK may build it: it must load in today's host. */
#include "help.h"

#undef PUNCTA_EXPORTED
#define PUNCTA_EXPORTED table_of_today
#include "plugin.c"

static uint32_t describe_more(puncta_str *out) {
    static char text[8192];
    puncta_str today;
    uint32_t status = describe(&today);
    if (status || !out) return PUNCTA_STATUS_MISUSE;
    snprintf(text, sizeof text, "{\"later\": {\"a\": [1, null]}, %.*s", (int)today.len - 1, (const char *)today.ptr + 1);
    *out = text_of(text);
    return PUNCTA_STATUS_OK;
}

static const void *get_more(puncta_str id) {
    static const uint64_t preview[4] = {sizeof preview, 0, 0, 0};
    return text_is(id, "preview/1") ? (const void *)preview : get(id);
}

typedef struct {
    puncta_plugin today;
    uint64_t more[4];
} later;

PUNCTA_EXPORT const later puncta_plugin_v0_1 = {
    {sizeof(later), 0, 99, PUNCTA_ABI_NUMBER, describe_more, create, destroy, get_more},
    {1, 2, 3, 4},
};
