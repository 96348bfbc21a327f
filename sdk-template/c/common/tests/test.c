/* The plugin's tables and refusals without the host. */
#include "help.h"

extern const puncta_plugin PUNCTA_EXPORTED;

static int failures;
static char reason[1024];

static void expect(bool good, const char *what) {
    if (good) return;
    fprintf(stderr, "failed: %s\n", what);
    failures++;
}

static void keep_reason(uint64_t job, puncta_str document) {
    (void)job;
    snprintf(reason, sizeof reason, "%.*s", (int)document.len, (const char *)document.ptr);
}

static const void *tables(puncta_str id) {
    static const puncta_data_1 data = {.size = sizeof data};
    static const puncta_job_1 jobs = {.size = sizeof jobs, .fail = keep_reason};
    return text_is(id, PUNCTA_DATA_1) ? (const void *)&data : text_is(id, PUNCTA_JOB_1) ? (const void *)&jobs : NULL;
}

static const void *nothing(puncta_str id) {
    (void)id;
    return NULL;
}

int main(void) {
    const puncta_plugin *plugin = &PUNCTA_EXPORTED;
    puncta_str manifest = {NULL, 0};
    char id[128];
    expect(plugin->size == sizeof *plugin && plugin->number == PUNCTA_ABI_NUMBER, "the table is of this header");
    expect(plugin->describe(&manifest) == PUNCTA_STATUS_OK, "it describes itself");
    expect(json_text(manifest, "id", id, sizeof id) && strcmp(id, "lab.my-plugin") == 0, "its id");
    expect(json_text(manifest, "operations.0.title", id, sizeof id), "it has an operation");

    puncta_host poor = {sizeof poor, 0, 1, PUNCTA_ABI_NUMBER, nothing};
    puncta_host host = {sizeof host, 0, 1, PUNCTA_ABI_NUMBER, tables};
    uint64_t instance = 0;
    expect(plugin->create(&poor, &instance) != PUNCTA_STATUS_OK, "a host without tables is refused");
    expect(plugin->create(&host, &instance) == PUNCTA_STATUS_OK, "a host with tables is not");

    const puncta_call_1 *calls = plugin->get(TEXT("call/1"));
    puncta_plan plan;
    expect(calls && calls->size == sizeof *calls && !plugin->get(TEXT("call/2")), "it has call/1 only");
    puncta_str request = TEXT("{\"format\": \"puncta.request/1\", \"operation\": \"lab.other/1\"}");
    expect(calls && calls->prepare(instance, 1, request, &plan) != PUNCTA_STATUS_OK, "other operations are refused");
    expect(strstr(reason, "no such operation") != NULL, "with a reason");
    plugin->destroy(instance);
    puts(failures ? "failed" : "all good");
    return failures != 0;
}
