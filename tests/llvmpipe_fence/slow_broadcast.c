/* Makes llvmpipe's use after free likely, and counts it; to be preloaded.
 *
 *     gcc -shared -fPIC -O1 -o slow_broadcast.so slow_broadcast.c -ldl
 *     LD_PRELOAD=$PWD/slow_broadcast.so LP_NUM_THREADS=2 python plain_gl.py 60
 *
 * llvmpipe's threads sleep 0.3 ms in every 16th pthread_cond_broadcast, which lp_fence_signal calls between counting
 * and unlocking. A condition variable that another thread destroys while such a thread is between its broadcast and
 * the unlock that follows was freed too early: the unlock will write into freed memory. How many it were is written to
 * standard error at the end; each appends a byte to the file SLOW_BROADCAST_COUNT, where that is set.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define THREADS 64

static int (*broadcast)(pthread_cond_t *), (*destroy)(pthread_cond_t *), (*unlock)(pthread_mutex_t *);
static _Atomic(pthread_cond_t *) signalling[THREADS]; /* by each of llvmpipe's threads, until it unlocks */
static atomic_int threads, freed_too_early;
static __thread int me = -1; /* number among llvmpipe's threads, THREADS for all others */
static __thread unsigned calls;

__attribute__((constructor)) static void find(void)
{
    broadcast = (int (*)(pthread_cond_t *))dlvsym(RTLD_NEXT, "pthread_cond_broadcast", "GLIBC_2.3.2");
    destroy = (int (*)(pthread_cond_t *))dlvsym(RTLD_NEXT, "pthread_cond_destroy", "GLIBC_2.3.2");
    unlock = (int (*)(pthread_mutex_t *))dlsym(RTLD_NEXT, "pthread_mutex_unlock");
}

static int number(void)
{
    if (me < 0) {
        char name[32] = {0};
        pthread_getname_np(pthread_self(), name, sizeof name);
        me = strncmp(name, "llvmpipe", 8) ? THREADS : atomic_fetch_add(&threads, 1);
        if (me > THREADS)
            me = THREADS;
    }
    return me;
}

int pthread_cond_broadcast(pthread_cond_t *condition)
{
    if (!broadcast)
        find();
    if (number() < THREADS) {
        atomic_store(&signalling[me], condition);
        if (++calls % 16 == 0) {
            struct timespec pause = {0, 300000};
            nanosleep(&pause, NULL);
        }
    }
    return broadcast(condition);
}

int pthread_mutex_unlock(pthread_mutex_t *mutex)
{
    if (!unlock)
        find();
    int result = unlock(mutex);
    if (me >= 0 && me < THREADS)
        atomic_store(&signalling[me], NULL);
    return result;
}

int pthread_cond_destroy(pthread_cond_t *condition)
{
    if (!destroy)
        find();
    for (int i = 0; i < THREADS; i++)
        if (atomic_load(&signalling[i]) == condition) {
            const char *path = getenv("SLOW_BROADCAST_COUNT");
            int file = path ? open(path, O_WRONLY | O_CREAT | O_APPEND, 0644) : -1;
            atomic_fetch_add(&freed_too_early, 1);
            if (file >= 0) {
                if (write(file, "x", 1) != 1)
                    perror(path);
                close(file);
            }
            break;
        }
    return destroy(condition);
}

__attribute__((destructor)) static void end(void)
{
    if (atomic_load(&threads))
        fprintf(stderr, "%d fences freed too early\n", atomic_load(&freed_too_early));
}
