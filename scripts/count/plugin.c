/* A plugin for QEMU that counts how often each instruction is executed: for each block of code that QEMU translates,
 * a counter and the addresses of its instructions. At the end they are written to a file, an address and a number a
 * line. Given: out=FILE. It uses the interface of qemu-plugin.h, version 1 (QEMU 4.2 to 8), of which Debian has no
 * header.
 *
 *   gcc -shared -fPIC -O1 plugin.c -o plugin.so
 *   qemu-aarch64 -plugin plugin.so,out=counts.txt PROGRAM */
#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct qemu_plugin_tb;
struct qemu_plugin_insn;
enum { ADD_U64 = 0 };
void qemu_plugin_register_vcpu_tb_trans_cb(uint64_t id, void (*translated)(uint64_t, struct qemu_plugin_tb *));
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *block);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *block, size_t i);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *instruction);
void qemu_plugin_register_vcpu_tb_exec_inline(struct qemu_plugin_tb *block, int what, void *counter, uint64_t by);
void qemu_plugin_register_atexit_cb(uint64_t id, void (*ended)(uint64_t, void *), void *data);

int qemu_plugin_version = 1;

struct block {
    struct block *next;
    uint64_t executed;
    size_t length;
    uint64_t addresses[];
};

static struct block *blocks;
static char path[4096];

static void translated(uint64_t id, struct qemu_plugin_tb *block) {
    (void)id;
    const size_t n = qemu_plugin_tb_n_insns(block);
    struct block *own = calloc(1, sizeof *own + n * sizeof *own->addresses);
    if (own == NULL) {
        abort();
    }
    own->length = n;
    for (size_t i = 0; i < n; i++) {
        own->addresses[i] = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(block, i));
    }
    own->next = blocks;
    blocks = own;
    qemu_plugin_register_vcpu_tb_exec_inline(block, ADD_U64, &own->executed, 1);
}

static void ended(uint64_t id, void *data) {
    (void)id;
    (void)data;
    FILE *out = fopen(path, "w");
    if (out == NULL) {
        abort();
    }
    for (const struct block *block = blocks; block != NULL; block = block->next) {
        for (size_t i = 0; i < block->length && block->executed > 0; i++) {
            fprintf(out, "%" PRIx64 " %" PRIu64 "\n", block->addresses[i], block->executed);
        }
    }
    fclose(out);
}

int qemu_plugin_install(uint64_t id, const void *about, int count, char **options) {
    (void)about;
    for (int i = 0; i < count; i++) {
        if (strncmp(options[i], "out=", 4) == 0) {
            snprintf(path, sizeof path, "%s", options[i] + 4);
        }
    }
    if (path[0] == 0) {
        fputs("plugin: give out=FILE\n", stderr);
        return 1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, ended, NULL);
    return 0;
}
