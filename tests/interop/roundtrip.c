/* SPDX-FileCopyrightText: 2026 the CDFF contributors
 * SPDX-License-Identifier: BSD-3-Clause
 *
 * roundtrip TYPE < UPER > UPER: reads a message with the code of asn1c and writes it again.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "CorrespondenceMap2D.h"
#include "CorrespondenceMap2DLarge.h"
#include "Frame.h"
#include "GroundAreas.h"
#include "IMUSensors.h"
#include "JointsTrajectory.h"
#include "LaserScan.h"
#include "LidarScan.h"
#include "Map.h"
#include "PointSequence.h"
#include "Pointcloud.h"
#include "PoseGraph.h"
#include "PoseTrajectory.h"
#include "RigidBodyState.h"
#include "TransformWithCovariance.h"
#include "VisualPointFeatureVector3D.h"

#define TYPE(name) {#name, &asn_DEF_##name}
static struct {
    const char *name;
    asn_TYPE_descriptor_t *type;
} types[] = {TYPE(CorrespondenceMap2D), TYPE(CorrespondenceMap2DLarge), TYPE(Frame), TYPE(GroundAreas),
             TYPE(IMUSensors), TYPE(JointsTrajectory), TYPE(LaserScan), TYPE(LidarScan), TYPE(Map), TYPE(PointSequence),
             TYPE(Pointcloud), TYPE(PoseGraph), TYPE(PoseTrajectory), TYPE(RigidBodyState),
             TYPE(TransformWithCovariance), TYPE(VisualPointFeatureVector3D)};

static unsigned char buffer[1 << 23];

int main(int argc, char **argv) {
    const size_t size = fread(buffer, 1, sizeof buffer, stdin);
    for (size_t i = 0; argc == 2 && i < sizeof types / sizeof *types; ++i) {
        void *message = NULL;
        if (strcmp(types[i].name, argv[1])) continue;
        if (uper_decode_complete(NULL, types[i].type, &message, buffer, size).code != RC_OK) return 3;
        const asn_enc_rval_t written = uper_encode_to_buffer(types[i].type, message, buffer, sizeof buffer);
        if (written.encoded < 0) return 4;
        fwrite(buffer, 1, (written.encoded + 7) / 8, stdout);
        return 0;
    }
    return 2;
}
