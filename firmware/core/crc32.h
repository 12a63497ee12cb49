/* CRC-32 of IEEE 802.3 (reflected, polynomial 0xEDB88320), the one of zlib and Ethernet. */
#ifndef PF_CRC32_H
#define PF_CRC32_H

#include <stdint.h>

uint32_t crc32(const char *bytes, uint16_t count);

#endif
