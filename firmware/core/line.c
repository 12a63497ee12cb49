#include "line.h"

#include "crc32.h"

#define CHECK 9      /* '*' and eight hex digits */
#define ROOM (PF_LINE - CHECK - 1)

static const char digits[] = "0123456789ABCDEF";

static int hex_value(char c)
{
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

static bool checked(struct line_reader *reader)
{
    if (reader->length <= CHECK) return false;
    uint8_t count = (uint8_t)(reader->length - CHECK);
    uint32_t told = 0;
    if (reader->text[count] != '*') return false;
    for (uint8_t k = 1; k < CHECK; k++) {
        int value = hex_value(reader->text[count + k]);
        if (value < 0) return false;
        told = told << 4 | (uint32_t)value;
    }
    if (told != crc32(reader->text, count)) return false;
    reader->text[count] = '\0';
    return true;
}

enum line_result line_feed(struct line_reader *reader, char byte)
{
    if (byte == '\n') {
        bool empty = reader->length == 0 && !reader->too_long;
        bool good = !reader->too_long && checked(reader);
        reader->length = 0;
        reader->too_long = false;
        return empty ? LINE_NONE : good ? LINE_GOOD : LINE_BAD;
    }
    if (reader->length == PF_LINE) reader->too_long = true;
    else reader->text[reader->length++] = byte;
    return LINE_NONE;
}

bool line_unsigned(const char **place, uint32_t *value)
{
    const char *p = *place;
    uint32_t result = 0;
    if (*p++ != ',' || *p < '0' || *p > '9') return false;
    for (; *p >= '0' && *p <= '9'; p++) {
        uint32_t digit = (uint32_t)(*p - '0');
        if (result > (UINT32_MAX - digit) / 10u) return false;
        result = result * 10u + digit;
    }
    if (*p != ',' && *p != '\0') return false;
    *place = p;
    *value = result;
    return true;
}

bool line_integer(const char **place, int32_t *value)
{
    const char *p = *place;
    bool negative = p[0] == ',' && p[1] == '-';
    int32_t result = 0;
    p += negative ? 2 : 1;
    if (**place != ',' || *p < '0' || *p > '9') return false;
    for (; *p >= '0' && *p <= '9'; p++) {
        int32_t digit = *p - '0';
        if (result > (INT32_MAX - digit) / 10) return false;
        result = result * 10 + digit;
    }
    if (*p != ',' && *p != '\0') return false;
    *place = p;
    *value = negative ? -result : result;
    return true;
}

static void add(struct line_writer *writer, char c)
{
    if (writer->length < ROOM) writer->text[writer->length++] = c;
}

void line_begin(struct line_writer *writer, char kind)
{
    writer->length = 0;
    add(writer, kind);
}

void line_add_text(struct line_writer *writer, const char *text)
{
    add(writer, ',');
    for (; *text; text++) add(writer, *text);
}

/* By subtraction: small processors take 40 us for a division of 32 bits. */
void line_add_unsigned(struct line_writer *writer, uint32_t value)
{
    static const uint32_t powers[10] = {1000000000u, 100000000u, 10000000u, 1000000u, 100000u, 10000u, 1000u, 100u, 10u, 1u};
    bool begun = false;
    add(writer, ',');
    for (uint8_t k = 0; k < 10; k++) {
        char digit = '0';
        for (; value >= powers[k]; value -= powers[k]) digit++;
        begun = begun || digit != '0' || k == 9;
        if (begun) add(writer, digit);
    }
}

void line_add_integer(struct line_writer *writer, int32_t value)
{
    if (value >= 0) {
        line_add_unsigned(writer, (uint32_t)value);
        return;
    }
    line_add_text(writer, "-");
    uint8_t sign = writer->length;
    line_add_unsigned(writer, 0u - (uint32_t)value);
    for (uint8_t k = sign; k + 1 < writer->length; k++) writer->text[k] = writer->text[k + 1]; /* the comma behind the sign */
    if (sign < writer->length) writer->length--;
}

uint8_t line_end(struct line_writer *writer)
{
    uint32_t crc = crc32(writer->text, writer->length);
    writer->text[writer->length++] = '*';
    for (int8_t shift = 28; shift >= 0; shift = (int8_t)(shift - 4)) writer->text[writer->length++] = digits[(crc >> shift) & 15u];
    writer->text[writer->length++] = '\n';
    return writer->length;
}
