/* SPDX-FileCopyrightText: 2026 the CDFF contributors
 * SPDX-License-Identifier: BSD-3-Clause
 *
 * Wall clock with an offset, preloaded before libc: the offset is a 64-bit number of nanoseconds in the file
 * $CHAOS_CLOCKS/MODULE, where MODULE follows -m in the command line of the process. The monotonic clock is
 * unchanged.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static volatile const int64_t *offset_ns;

__attribute__((constructor)) static void open_offset(void)
{
    char line[4096] = {0}, path[4096];
    const char *folder = getenv("CHAOS_CLOCKS");
    int file = open("/proc/self/cmdline", O_RDONLY);
    ssize_t size = file < 0 ? -1 : read(file, line, sizeof line - 1);
    if (file >= 0)
        close(file);
    for (char *word = line; folder && word < line + size; word += strlen(word) + 1) {
        if (strcmp(word, "-m") != 0)
            continue;
        snprintf(path, sizeof path, "%s/%s", folder, word + 3);
        file = open(path, O_RDONLY | O_CLOEXEC);
        if (file < 0)
            return;
        void *mapped = mmap(NULL, sizeof *offset_ns, PROT_READ, MAP_SHARED, file, 0);
        close(file);
        offset_ns = mapped == MAP_FAILED ? NULL : mapped;
        return;
    }
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static int (*original)(clockid_t, struct timespec *);
    if (!original)
        original = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int result = original(clock, now);
    if (result == 0 && offset_ns && clock == CLOCK_REALTIME) {
        int64_t ns = now->tv_sec * INT64_C(1000000000) + now->tv_nsec + *offset_ns;
        now->tv_sec = ns / INT64_C(1000000000);
        now->tv_nsec = ns % INT64_C(1000000000);
    }
    return result;
}

int gettimeofday(struct timeval *restrict now, void *restrict zone)
{
    struct timespec exact;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &exact);
    now->tv_sec = exact.tv_sec;
    now->tv_usec = exact.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *now)
{
    struct timespec exact;
    clock_gettime(CLOCK_REALTIME, &exact);
    if (now)
        *now = exact.tv_sec;
    return exact.tv_sec;
}
