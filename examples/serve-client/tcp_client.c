/* Steers an oscillator by `pinc serve .. --listen 127.0.0.1:5025`, with POSIX sockets.
   cc -std=c99 -o client examples/serve-client/tcp_client.c && ./client 5025 */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* Sends a line and reads the answer; 0 unless it is an error or there is none. */
static int ask(FILE *from, int to, const char *request, char *answer, int size)
{
    const size_t length = strlen(request);
    if (write(to, request, length) != (ssize_t)length || fgets(answer, size, from) == NULL) {
        return 1;
    }
    return strncmp(answer, "{\"error\"", 8) == 0;
}

int main(int argc, char **argv)
{
    struct sockaddr_in place = {.sin_family = AF_INET};
    double x1 = 1.0, x2 = 0.0;
    char request[128], answer[1024];
    const int line = socket(AF_INET, SOCK_STREAM, 0);
    place.sin_port = htons((unsigned short)((argc > 1) ? atoi(argv[1]) : 5025));
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (line < 0 || connect(line, (struct sockaddr *)&place, sizeof(place)) != 0) {
        perror("pinc serve");
        return 1;
    }
    FILE *from = fdopen(line, "r");
    int failed = ask(from, line, "{\"command\": \"reset\"}\n", answer, sizeof(answer));
    for (int k = 0; k < 40 && !failed; k++) {
        snprintf(request, sizeof(request),
                 "{\"y\": [%.17g, %.17g], \"reference\": [-0.5, 0.0]}\n", x1, x2);
        failed = ask(from, line, request, answer, sizeof(answer));
        const char *chosen = failed ? NULL : strstr(answer, "\"u\":[");
        const double u = (chosen != NULL) ? strtod(chosen + 5, NULL) : 0.0;
        for (int i = 0; i < 1000; i++) { /* the plant: the oscillator, by Euler's method */
            const double h = 0.5 / 1000, slope = (1 - x1 * x1) * x2 - x1 + u;
            x1 += h * x2;
            x2 += h * slope;
        }
    }
    if (failed) {
        fputs(answer, stderr);
    } else {
        printf("x1 = %.4f\n", x1);
    }
    return failed;
}
