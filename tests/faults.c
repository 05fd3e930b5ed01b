/* SPDX-FileCopyrightText: 2026 the CDFF contributors
 * SPDX-License-Identifier: BSD-3-Clause
 *
 * Calls that fail when told to: preloaded before libc by tests.fault_load. faults_arm(call, path, skip, times, error)
 * lets `times` calls fail after `skip` good ones, on files whose path holds `path`; faults_injected() says how many did.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/types.h>
#include <unistd.h>

enum call { WRITE, SYNC, RENAME, UNLINK, TRUNCATE };

static int armed = -1, skip, times, error, injected, seen;
static char part[256];

void faults_arm(int call, const char *path, int skipped, int count, int number) {
    strncpy(part, path, sizeof part - 1);
    skip = skipped, times = count, error = number, injected = seen = 0;
    armed = call;
}
int faults_injected(void) { return injected; }
int faults_seen(void) { return seen; }

static int fails_at(int call, const char *path) {
    if (call != armed || !strstr(path, part)) return 0;
    if (seen++ < skip || injected >= times) return 0;
    injected++;
    errno = error;
    return 1;
}
static int fails(int call, int file) {
    char link[64], path[4096];
    if (call != armed) return 0;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t n = readlink(link, path, sizeof path - 1);
    if (n < 0) return 0;
    path[n] = 0;
    return fails_at(call, path);
}
#define REAL(name) static __typeof__(name) *real; if (!real) real = (__typeof__(name) *)dlsym(RTLD_NEXT, #name)

ssize_t write(int f, const void *b, size_t n) { REAL(write); return fails(WRITE, f) ? -1 : real(f, b, n); }
ssize_t pwrite(int f, const void *b, size_t n, off_t o) { REAL(pwrite); return fails(WRITE, f) ? -1 : real(f, b, n, o); }
ssize_t pwrite64(int f, const void *b, size_t n, off64_t o) {
    REAL(pwrite64);
    return fails(WRITE, f) ? -1 : real(f, b, n, o);
}
int fsync(int f) { REAL(fsync); return fails(SYNC, f) ? -1 : real(f); }
int fdatasync(int f) { REAL(fdatasync); return fails(SYNC, f) ? -1 : real(f); }
int ftruncate(int f, off_t n) { REAL(ftruncate); return fails(TRUNCATE, f) ? -1 : real(f, n); }
int ftruncate64(int f, off64_t n) { REAL(ftruncate64); return fails(TRUNCATE, f) ? -1 : real(f, n); }
int fallocate(int f, int m, off_t o, off_t n) { REAL(fallocate); return fails(TRUNCATE, f) ? -1 : real(f, m, o, n); }
int rename(const char *a, const char *b) { REAL(rename); return fails_at(RENAME, b) ? -1 : real(a, b); }
int unlink(const char *a) { REAL(unlink); return fails_at(UNLINK, a) ? -1 : real(a); }
