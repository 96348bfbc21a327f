/* A reader in C: points from text files that begin with POINTS, with x and y in each line. */
#include "help.h"

static const char MANIFEST[] =
    "{\"format\": \"puncta.plugin/1\", \"id\": \"lab.my-plugin\", \"title\": \"My plugin\","
    " \"version\": \"0.1.0\", \"license\": \"MIT OR Apache-2.0\", \"isolation\": \"worker\", \"reentrant\": true,"
    " \"description\": \"Reads points.\", \"needs\": [\"data/1\", \"job/1\"],"
    " \"operations\": [{\"id\": \"lab.my-plugin.read/1\", \"kind\": \"reader\", \"title\": \"Points\","
    " \"description\": \"Reads points from text: the word POINTS, then x and y in each line.\","
    " \"outputs\": [{\"name\": \"localisations\", \"kind\": \"table\"}],"
    " \"file\": {\"suffixes\": [\".points\"], \"magic\": [\"504f494e5453\"], \"formats\": [\"Points\"]},"
    " \"example\": {\"file\": {\"name\": \"small.points\", \"text\": \"POINTS\\n1.5 2\\n3 4.25\\n\"}}}]}";

static const char PLAN[] =
    "{\"format\": \"puncta.plan/1\", \"probe\": {\"format\": \"Points\", \"confidence\": 1}}";

static const puncta_data_1 *data;
static const puncta_job_1 *jobs;

/* Rows that are read at a time. */
enum { BLOCK = 65536 };

/* A plan is the path of its file. Only the beginning of the file is looked at. */
static uint32_t prepare(uint64_t instance, uint64_t job, puncta_str request, puncta_plan *plan) {
    (void)instance;
    char operation[128], path[4096], head[6];
    if (!json_text(request, "operation", operation, sizeof operation) ||
        strcmp(operation, "lab.my-plugin.read/1") != 0)
        return fail(jobs, job, "unsupported", "there is no such operation in this plugin");
    if (!json_text(request, "file.path", path, sizeof path)) return fail(jobs, job, "io", "there is no file to read");
    FILE *file = fopen(path, "rb");
    if (!file) return fail(jobs, job, "io", "the file cannot be opened");
    size_t count = fread(head, 1, sizeof head, file);
    fclose(file);
    if (count < sizeof head || memcmp(head, "POINTS", sizeof head) != 0)
        return fail(jobs, job, "not-mine", "the file does not begin with POINTS");
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

/* Two numbers and nothing else: 1. An empty line: 0. Anything else: -1. */
static int numbers(const char *line, double *x, double *y) {
    char *rest;
    line += strspn(line, " \t\r\n");
    if (!*line) return 0;
    *x = strtod(line, &rest);
    if (rest == line) return -1;
    line = rest;
    *y = strtod(line, &rest);
    if (rest == line) return -1;
    rest += strspn(rest, " \t\r\n");
    return *rest ? -1 : 1;
}

/* Reads all lines into an output that grows. */
static uint32_t lines(uint64_t job, FILE *file, uint64_t output, uint64_t *rows) {
    char line[512], message[128];
    puncta_column columns[2];
    uint32_t count, status;
    uint64_t room = 0;
    for (unsigned long number = 1; fgets(line, sizeof line, file); number++) {
        if (number == 1) continue;
        if (*rows == room) {
            room += BLOCK;
            if ((status = data->grow(job, output, 0, room))) return status;
            if ((status = data->columns(job, output, 0, columns, 2, &count))) return status;
            if ((status = data->commit(job, output, 0, BLOCK))) return status;
        }
        double x = 0, y = 0;
        int found = numbers(line, &x, &y);
        if (found < 0) {
            snprintf(message, sizeof message, "line %lu of the file is not two numbers", number);
            return fail(jobs, job, "bad-file", message);
        }
        if (found == 0) continue;
        ((double *)columns[0].data)[*rows] = x;
        ((double *)columns[1].data)[*rows] = y;
        if (++*rows % 4096 == 0 && (status = jobs->cancelled(job))) return status;
    }
    return PUNCTA_STATUS_OK;
}

static uint32_t run(uint64_t instance, uint64_t job, uint64_t plan) {
    (void)instance;
    static const char OUTPUT[] =
        "{\"format\": \"puncta.output/1\", \"output\": \"localisations\", \"header\": {\"kind\": \"table\","
        " \"name\": \"localisations\", \"parts\": [{\"name\": \"rows\", \"rows\": 0, \"columns\": ["
        "{\"name\": \"x\", \"type\": \"f64\", \"unit\": \"nm\", \"role\": \"position\"},"
        " {\"name\": \"y\", \"type\": \"f64\", \"unit\": \"nm\", \"role\": \"position\"}]}]}}";
    uint64_t output, rows = 0;
    uint32_t status = data->begin(job, TEXT(OUTPUT), &output);
    if (status) return status;
    FILE *file = fopen((const char *)(uintptr_t)plan, "rb");
    if (!file) return fail(jobs, job, "io", "the file cannot be opened");
    status = lines(job, file, output, &rows);
    fclose(file);
    if (status) return status;
    return data->finish(job, output, &rows, 1, TEXT(""));
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
