/* Lines of the recording protocol: FIELD,FIELD,...*CRC32 in 8 hex digits, ended by a line feed. */
#ifndef PF_LINE_H
#define PF_LINE_H

#include <stdbool.h>
#include <stdint.h>

#define PF_LINE 160 /* bytes of the longest line with checksum and line feed */

struct line_reader {
    char text[PF_LINE];
    uint8_t length;
    bool too_long;
};

enum line_result { LINE_NONE, LINE_GOOD, LINE_BAD };

/* Takes one byte; after LINE_GOOD `text` is the line without checksum, ended by a zero. */
enum line_result line_feed(struct line_reader *reader, char byte);

/* Reads ",integer" at *place and moves on; false, without moving, where there is none that fits. */
bool line_integer(const char **place, int32_t *value);
bool line_unsigned(const char **place, uint32_t *value);

struct line_writer {
    char text[PF_LINE];
    uint8_t length;
};

void line_begin(struct line_writer *writer, char kind);
void line_add_text(struct line_writer *writer, const char *text);
void line_add_integer(struct line_writer *writer, int32_t value);
void line_add_unsigned(struct line_writer *writer, uint32_t value);
/* Adds checksum and line feed; returns the bytes to send. */
uint8_t line_end(struct line_writer *writer);

#endif
