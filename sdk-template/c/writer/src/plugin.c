/* A writer in C: points as text, x and y in each line after the word POINTS. */
#include "help.h"

static const char MANIFEST[] =
    "{\"format\": \"puncta.plugin/1\", \"id\": \"lab.my-plugin\", \"title\": \"My plugin\","
    " \"version\": \"0.1.0\", \"license\": \"MIT OR Apache-2.0\", \"isolation\": \"worker\", \"reentrant\": true,"
    " \"description\": \"Writes points.\", \"needs\": [\"data/1\", \"job/1\"],"
    " \"operations\": [{\"id\": \"lab.my-plugin.write/1\", \"kind\": \"writer\", \"title\": \"Points\","
    " \"description\": \"Writes points as text: the word POINTS, then x and y in each line.\","
    " \"inputs\": [{\"name\": \"table\", \"kind\": \"table\", \"columns\":"
    "   [{\"name\": \"x\", \"unit\": \"nm\"}, {\"name\": \"y\", \"unit\": \"nm\"}]}],"
    " \"file\": {\"suffixes\": [\".points\"]}, \"example\": {}}]}";

static const char PLAN[] =
    "{\"format\": \"puncta.plan/1\", \"read\": [{\"input\": 0, \"columns\": [\"x\", \"y\"]}]}";

static const puncta_data_1 *data;
static const puncta_job_1 *jobs;

/* A plan is the path of its file. */
static uint32_t prepare(uint64_t instance, uint64_t job, puncta_str request, puncta_plan *plan) {
    (void)instance;
    char operation[128], path[4096];
    if (!json_text(request, "operation", operation, sizeof operation) ||
        strcmp(operation, "lab.my-plugin.write/1") != 0)
        return fail(jobs, job, "unsupported", "there is no such operation in this plugin");
    if (!json_text(request, "file.path", path, sizeof path)) return fail(jobs, job, "io", "there is no file to write");
    if (json_column(request, 0, "x") < 0 || json_column(request, 0, "y") < 0)
        return fail(jobs, job, "bad-input", "the table has no columns x and y");
    char *kept = malloc(strlen(path) + 1);
    if (!kept) return fail(jobs, job, "resources", "there is no memory");
    strcpy(kept, path);
    plan->handle = (uint64_t)(uintptr_t)kept;
    plan->document = TEXT(PLAN);
    return PUNCTA_STATUS_OK;
}

static void drop(uint64_t instance, uint64_t plan) {
    (void)instance;
    free((void *)(uintptr_t)plan);
}

static uint32_t run(uint64_t instance, uint64_t job, uint64_t plan) {
    (void)instance;
    puncta_column columns[2];
    uint32_t count = 0, status;
    if ((status = data->columns(job, 0, 0, columns, 2, &count)) || count != 2)
        return fail(jobs, job, "bad-input", "the table has no columns x and y");
    for (int i = 0; i < 2; i++)
        if (columns[i].kind >= PUNCTA_KIND_UTF8 || columns[i].width != 1)
            return fail(jobs, job, "bad-input", "columns x and y are not of numbers");
    FILE *file = fopen((const char *)(uintptr_t)plan, "wb");
    if (!file) return fail(jobs, job, "io", "the file cannot be written");
    bool good = fputs("POINTS\n", file) >= 0;
    for (uint64_t row = 0; good && row < columns[0].rows; row++) {
        if (row % 4096 == 0 && (status = jobs->cancelled(job))) {
            fclose(file);
            return status;
        }
        good = fprintf(file, "%.3f %.3f\n", value_at(&columns[0], row), value_at(&columns[1], row)) > 0;
    }
    if (fclose(file) || !good) return fail(jobs, job, "io", "the file cannot be written");
    return PUNCTA_STATUS_OK;
}

static uint32_t describe(puncta_str *out) {
    if (!out) return PUNCTA_STATUS_MISUSE;
    *out = TEXT(MANIFEST);
    return PUNCTA_STATUS_OK;
}

static uint32_t create(const puncta_host *host, uint64_t *out) {
    if (!host || !out) return PUNCTA_STATUS_MISUSE;
    const puncta_data_1 *its_data = host->get(TEXT(PUNCTA_DATA_1));
    const puncta_job_1 *its_jobs = host->get(TEXT(PUNCTA_JOB_1));
    if (!its_data || !its_jobs) return PUNCTA_STATUS_FAILED;
    data = its_data;
    jobs = its_jobs;
    *out = 1;
    return PUNCTA_STATUS_OK;
}

static void destroy(uint64_t instance) { (void)instance; }

static const void *get(puncta_str id) {
    static const puncta_call_1 calls = {sizeof calls, 0, prepare, run, drop};
    return text_is(id, PUNCTA_CALL_1) ? &calls : NULL;
}

PUNCTA_EXPORT const puncta_plugin PUNCTA_EXPORTED = {
    sizeof(puncta_plugin), 0, 1, PUNCTA_ABI_NUMBER, describe, create, destroy, get,
};
