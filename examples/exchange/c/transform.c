/* SPDX-FileCopyrightText: 2026 the CDFF contributors
 * SPDX-License-Identifier: BSD-3-Clause
 *
 * transform IN OUT: reads a TransformWithCovariance in UPER, prints it, moves the child 1 m along x, writes it.
 */
#include <stdio.h>
#include <stdlib.h>

#include "TransformWithCovariance.h"

static unsigned char buffer[1 << 16];

static void fail(const char *what) {
    fprintf(stderr, "transform: %s\n", what);
    exit(1);
}

int main(int argc, char **argv) {
    if (argc != 3) fail("usage: transform IN OUT");
    FILE *in = fopen(argv[1], "rb");
    if (!in) fail("IN cannot be read");
    const size_t size = fread(buffer, 1, sizeof buffer, in);
    fclose(in);

    TransformWithCovariance_t *message = NULL;
    const asn_dec_rval_t read =
        uper_decode_complete(NULL, &asn_DEF_TransformWithCovariance, (void **)&message, buffer, size);
    if (read.code != RC_OK) fail("IN is no TransformWithCovariance in UPER");

    const OCTET_STRING_t *parent = &message->metadata.parentFrameId, *child = &message->metadata.childFrameId;
    printf("parent %.*s\nchild %.*s\n", (int)parent->size, (const char *)parent->buf, (int)child->size,
           (const char *)child->buf);
    printf("translation");
    for (int i = 0; i < message->data.translation.list.count; ++i) {
        double *value = message->data.translation.list.array[i];
        printf(" %.17g", *value);
        if (i == 0) *value += 1.0;
    }
    printf("\n");

    const asn_enc_rval_t written =
        uper_encode_to_buffer(&asn_DEF_TransformWithCovariance, message, buffer, sizeof buffer);
    if (written.encoded < 0) fail("the message cannot be encoded");
    FILE *out = fopen(argv[2], "wb");
    if (!out || fwrite(buffer, 1, (written.encoded + 7) / 8, out) == 0 || fclose(out)) fail("OUT cannot be written");
    ASN_STRUCT_FREE(asn_DEF_TransformWithCovariance, message);
    return 0;
}
