/* A node on Handrail's virtual CAN bus, in plain C: a thermometer that answers every Sync (0x080) with a CAN FD frame.
 *
 *     cc -std=c11 -O2 -o can_node can_node.c
 *     handrail can up can0 &                       (or a robot: handrail up talos_upper --scene valve)
 *     ./can_node /dev/shm/handrail-1000/bus.sock can0
 *     handrail can dump                            (and: handrail can send Sync Cycle=1)
 *
 * The wire format is in docs/can.md. Little-endian machines only, as the records are. */

#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

enum { WIRE_VERSION = 2, MAX_RECORDS = 512 };
enum { BRS = 1, ESI = 2, FD = 4, EXTENDED = 8, REMOTE = 16, LOST = 128 };

struct record {           /* one frame, 80 bytes, no padding */
    uint64_t time_ns;     /* end of frame on the bus's clock; the hub fills it in */
    uint32_t can_id;      /* 11 bits, or 29 with EXTENDED */
    uint8_t length;       /* bytes of data: 0..8, with FD also 12, 16, 20, 24, 32, 48, 64 */
    uint8_t flags;
    uint8_t bus;          /* index in the list of channels of our hello */
    uint8_t zero;
    uint8_t data[64];     /* zero beyond length */
};
_Static_assert(sizeof(struct record) == 80, "record");

static struct record batch[MAX_RECORDS];

/* Join the hub: one JSON datagram each way. Returns the socket, or -1 after saying why. */
static int join_hub(const char *path, const char *channel)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    char text[4096];
    if (strlen(path) >= sizeof address.sun_path) {
        fprintf(stderr, "can_node: %s: path too long for a socket\n", path);
        return -1;
    }
    strcpy(address.sun_path, path);
    int hub = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    if (hub < 0 || connect(hub, (struct sockaddr *)&address, sizeof address) < 0) {
        fprintf(stderr, "can_node: %s: %s\n", path, strerror(errno));
        if (hub >= 0)
            close(hub);
        return -1;
    }
    snprintf(text, sizeof text,
             "{\"type\":\"hello\",\"version\":%d,\"name\":\"thermometer\",\"channels\":[\"%s\"]}", WIRE_VERSION, channel);
    ssize_t size = -1;
    if (send(hub, text, strlen(text), MSG_NOSIGNAL) >= 0)
        size = recv(hub, text, sizeof text - 1, 0);
    text[size > 0 ? size : 0] = 0;
    if (!strstr(text, "\"welcome\"")) {
        fprintf(stderr, "can_node: the hub says: %s\n", size > 0 ? text : "nothing");
        close(hub);
        return -1;
    }
    return hub;
}

int main(int argc, char **argv)
{
    if (argc != 3) {
        fprintf(stderr, "usage: can_node SOCKET CHANNEL\n");
        return 2;
    }
    int hub = join_hub(argv[1], argv[2]);
    if (hub < 0)
        return 1;
    puts("can_node ready");
    fflush(stdout);

    uint8_t counter = 0;
    int16_t temperature = 215; /* 0.1 degrees */
    ssize_t size;
    while ((size = recv(hub, batch, sizeof batch, 0)) > 0) { /* a datagram is a whole number of records; 0: the hub has ended */
        for (struct record *frame = batch; frame < batch + size / (ssize_t)sizeof *frame; frame++) {
            if (frame->flags & LOST) {
                fprintf(stderr, "can_node: %u frames lost: this process reads too slowly\n", (unsigned)frame->can_id);
                continue;
            }
            if (frame->can_id != 0x080 || frame->flags & (EXTENDED | REMOTE) || frame->length < 4)
                continue;
            struct record answer = {.can_id = 0x500, .length = 8, .flags = FD | BRS, .bus = frame->bus};
            memcpy(answer.data, frame->data, 4); /* the host's cycle */
            memcpy(answer.data + 4, &temperature, 2);
            answer.data[6] = counter++;
            for (int i = 0; i < 7; i++)
                answer.data[7] ^= answer.data[i];
            if (send(hub, &answer, sizeof answer, MSG_NOSIGNAL) < 0)
                return 1;
        }
    }
    close(hub);
    return 0;
}
