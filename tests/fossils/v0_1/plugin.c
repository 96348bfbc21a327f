/* An operation in C: adds a column with the distance of each localisation from a point on the x axis. */
#include "help.h"

#include <math.h>

static const char MANIFEST[] =
    "{\"format\": \"puncta.plugin/1\", \"id\": \"fossil.v0-1\", \"title\": \"A plugin of ABI number 1\","
    " \"version\": \"0.1.0\", \"license\": \"MIT OR Apache-2.0\", \"isolation\": \"worker\", \"reentrant\": true,"
    " \"description\": \"Adds the distance from a point.\", \"needs\": [\"data/1\", \"job/1\"],"
    " \"operations\": [{\"id\": \"fossil.v0-1.distance/1\", \"kind\": \"operation\","
    " \"title\": \"Distance from a point\","
    " \"description\": \"Adds the distance of each localisation from a point on the x axis.\","
    " \"inputs\": [{\"name\": \"table\", \"kind\": \"table\", \"columns\": [{\"name\": \"x\", \"unit\": \"nm\"}]}],"
    " \"outputs\": [{\"name\": \"table\", \"kind\": \"table\", \"form\": \"columns\", \"of\": \"table\"}],"
    " \"parameters\": [{\"name\": \"position\", \"kind\": \"number\", \"unit\": \"nm\", \"default\": 0,"
    "   \"help\": \"Position of the point along x.\"}],"
    " \"example\": {\"parameters\": {\"position\": 100}}}]}";

static const char PLAN[] =
    "{\"format\": \"puncta.plan/1\", \"read\": [{\"input\": 0, \"columns\": [\"x\"]}]}";

static const puncta_data_1 *data;
static const puncta_job_1 *jobs;

/* What a call was prepared with. */
typedef struct {
    double position;
    uint64_t rows;
} call;

static uint32_t prepare(uint64_t instance, uint64_t job, puncta_str request, puncta_plan *plan) {
    (void)instance;
    char operation[128];
    double rows, position;
    if (!json_text(request, "operation", operation, sizeof operation) ||
        strcmp(operation, "fossil.v0-1.distance/1") != 0)
        return fail(jobs, job, "unsupported", "there is no such operation in this plugin");
    if (!json_number(request, "parameters.position", &position) || !isfinite(position))
        return fail(jobs, job, "bad-parameter", "position is a finite number of nm");
    if (!json_number(request, "inputs.0.header.parts.0.rows", &rows) || json_column(request, 0, "x") < 0)
        return fail(jobs, job, "bad-input", "the table has no column x");
    call *prepared = malloc(sizeof *prepared);
    if (!prepared) return fail(jobs, job, "resources", "there is no memory");
    *prepared = (call){position, (uint64_t)rows};
    plan->handle = (uint64_t)(uintptr_t)prepared;
    plan->document = TEXT(PLAN);
    return PUNCTA_STATUS_OK;
}

static void drop(uint64_t instance, uint64_t plan) {
    (void)instance;
    free((void *)(uintptr_t)plan);
}

static uint32_t run(uint64_t instance, uint64_t job, uint64_t plan) {
    (void)instance;
    const call *prepared = (const call *)(uintptr_t)plan;
    puncta_column x, distance;
    uint32_t count = 0, status;
    uint64_t output;
    if ((status = data->columns(job, 0, 0, &x, 1, &count)) || count != 1)
        return fail(jobs, job, "bad-input", "the table has no column x");
    if (x.kind >= PUNCTA_KIND_UTF8 || x.width != 1)
        return fail(jobs, job, "bad-input", "column x is not of numbers");
    char document[512];
    snprintf(document, sizeof document,
             "{\"format\": \"puncta.output/1\", \"output\": \"table\", \"form\": \"columns\", \"of\": 0,"
             " \"header\": {\"kind\": \"table\", \"parts\": [{\"name\": \"rows\", \"rows\": %llu,"
             " \"columns\": [{\"name\": \"distance\", \"type\": \"f64\", \"unit\": \"nm\"}]}]}}",
             (unsigned long long)x.rows);
    if ((status = data->begin(job, text_of(document), &output))) return status;
    if ((status = data->columns(job, output, 0, &distance, 1, &count))) return status;
    if ((status = data->commit(job, output, 0, x.rows))) return status;
    for (uint64_t row = 0; row < x.rows; row++) {
        /* Asking costs little, and every 50 ms is enough. */
        if (row % 65536 == 0 && (status = jobs->progress(job, (double)row / (double)x.rows, TEXT("distances"))))
            return status;
        ((double *)distance.data)[row] = fabs(value_at(&x, row) - prepared->position);
    }
    return data->finish(job, output, &x.rows, 1, TEXT(""));
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
