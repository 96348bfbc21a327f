/* Small helpers for plugins in C: finding values in JSON documents, writing texts, saying why a call fails.
 * Everything is static, so that a plugin is one translation unit. */
#ifndef PUNCTA_HELP_H
#define PUNCTA_HELP_H

#include "puncta.h"

#include <stdio.h>
#include <string.h>

#ifdef _WIN32
#define PUNCTA_EXPORT __declspec(dllexport)
#else
#define PUNCTA_EXPORT __attribute__((visibility("default")))
#endif

#define TEXT(literal) ((puncta_str){(const uint8_t *)(literal), sizeof(literal) - 1})

static inline puncta_str text_of(const char *text) {
    return (puncta_str){(const uint8_t *)text, strlen(text)};
}

static inline bool text_is(puncta_str text, const char *other) {
    return text.len == strlen(other) && (text.len == 0 || memcmp(text.ptr, other, text.len) == 0);
}

/* --- JSON: a cursor over bytes that never leaves them. */
typedef struct {
    const char *at, *end;
} json;

static inline void json_space(json *in) {
    while (in->at < in->end && memchr(" \t\r\n", *in->at, 4)) in->at++;
}

/* Steps over one value; false if there is none, or it is nested deeper than 128. */
static inline bool json_skip(json *in) {
    int depth = 0;
    do {
        json_space(in);
        if (in->at >= in->end) return false;
        char c = *in->at++;
        if (c == '"') {
            while (in->at < in->end && *in->at != '"') in->at += *in->at == '\\' ? 2 : 1;
            if (in->at >= in->end) return false;
            in->at++;
        } else if (c == '{' || c == '[') {
            if (++depth > 128) return false;
        } else if (c == '}' || c == ']') {
            if (--depth < 0) return false;
        } else if (c != ',' && c != ':') {
            while (in->at < in->end && !memchr(",:{}[] \t\r\n\"", *in->at, 11)) in->at++;
        }
    } while (depth > 0);
    return true;
}

/* The value at a path such as "inputs.0.header.name", as the bytes that it is written with; empty if there is none. */
static inline puncta_str json_find(puncta_str document, const char *path) {
    json in = {(const char *)document.ptr, (const char *)document.ptr + document.len};
    const puncta_str none = {NULL, 0};
    if (!document.ptr) return none;
    while (*path) {
        size_t length = strcspn(path, ".");
        json_space(&in);
        if (in.at >= in.end) return none;
        char open = *in.at++;
        if (open != '{' && open != '[') return none;
        bool found = false;
        for (long place = 0; !found; place++) {
            json_space(&in);
            if (in.at < in.end && *in.at == ',') in.at++;
            json_space(&in);
            if (in.at >= in.end || *in.at == '}' || *in.at == ']') return none;
            if (open == '{') {
                const char *name = in.at;
                if (*name != '"' || !json_skip(&in)) return none;
                found = (size_t)(in.at - name) == length + 2 && memcmp(name + 1, path, length) == 0;
                json_space(&in);
                if (in.at >= in.end || *in.at++ != ':') return none;
            } else {
                char *rest;
                found = strtol(path, &rest, 10) == place && rest == path + length;
            }
            if (!found && !json_skip(&in)) return none;
        }
        path += length;
        if (*path == '.') path++;
    }
    json_space(&in);
    const char *begin = in.at;
    if (!json_skip(&in)) return none;
    return (puncta_str){(const uint8_t *)begin, (uint64_t)(in.at - begin)};
}

/* The number at a path; false if there is none. */
static inline bool json_number(puncta_str document, const char *path, double *number) {
    puncta_str value = json_find(document, path);
    char copy[64], *rest;
    if (value.len == 0 || value.len >= sizeof copy) return false;
    memcpy(copy, value.ptr, value.len);
    copy[value.len] = 0;
    *number = strtod(copy, &rest);
    return rest != copy && *rest == 0;
}

/* The text at a path with its escapes of one letter undone; false if there is none, or no room. */
static inline bool json_text(puncta_str document, const char *path, char *out, size_t room) {
    puncta_str value = json_find(document, path);
    if (value.len < 2 || value.ptr[0] != '"') return false;
    size_t count = 0;
    for (uint64_t i = 1; i + 1 < value.len; i++) {
        char c = (char)value.ptr[i];
        if (c == '\\') {
            c = (char)value.ptr[++i];
            if (c == 'u') return false;
            c = c == 'n' ? '\n' : c == 't' ? '\t' : c == 'r' ? '\r' : c == 'b' ? '\b' : c == 'f' ? '\f' : c;
        }
        if (count + 1 >= room) return false;
        out[count++] = c;
    }
    out[count] = 0;
    return true;
}

/* The place of a column in a part of an input's header; -1 if there is none. */
static inline int json_column(puncta_str request, int input, const char *name) {
    char path[96], found[256];
    for (int place = 0; place < 16384; place++) {
        snprintf(path, sizeof path, "inputs.%d.header.parts.0.columns.%d.name", input, place);
        if (json_find(request, path).len == 0) return -1;
        if (json_text(request, path, found, sizeof found) && strcmp(found, name) == 0) return place;
    }
    return -1;
}

/* Says why a call fails. `message` holds no quotes and no backslashes. */
static inline uint32_t fail(const puncta_job_1 *jobs, uint64_t job, const char *code, const char *message) {
    char document[1024];
    snprintf(document, sizeof document,
             "{\"format\": \"puncta.failure/1\", \"code\": \"%s\", \"message\": \"%s\"}", code, message);
    jobs->fail(job, text_of(document));
    return strcmp(code, "not-mine") == 0 ? PUNCTA_STATUS_NOT_MINE : PUNCTA_STATUS_FAILED;
}

/* A value of a column of any kind of number; NaN for texts. */
static inline double value_at(const puncta_column *column, uint64_t row) {
    switch (column->kind) {
    case PUNCTA_KIND_BOOL:
    case PUNCTA_KIND_U8: return column->data[row];
    case PUNCTA_KIND_I8: return ((const int8_t *)column->data)[row];
    case PUNCTA_KIND_U16: return ((const uint16_t *)column->data)[row];
    case PUNCTA_KIND_I16: return ((const int16_t *)column->data)[row];
    case PUNCTA_KIND_U32: return ((const uint32_t *)column->data)[row];
    case PUNCTA_KIND_I32: return ((const int32_t *)column->data)[row];
    case PUNCTA_KIND_U64: return (double)((const uint64_t *)column->data)[row];
    case PUNCTA_KIND_I64: return (double)((const int64_t *)column->data)[row];
    case PUNCTA_KIND_F32: return ((const float *)column->data)[row];
    case PUNCTA_KIND_F64: return ((const double *)column->data)[row];
    default: return 0.0 / 0.0;
    }
}

#endif
